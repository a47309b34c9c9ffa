// Measures reference spots with the pipeline's own centroids, so that the reference itself has
// slopes of 0.
#pragma once

#include <string>

#include "acquisition/frame_source.h"
#include "centroiding/centroid.h"
#include "centroiding/sensor.h"

namespace curlew {

struct ReferenceReport {
  int dropped = 0;   ///< lenslets taken out of the sensor
  std::string text;  ///< a sentence on these lenslets; empty if there are none
};

/// Runs find_centroids over all frames of the source, and sets the sensor's references and fluxes
/// to the means over the frames in which the lenslet is valid. A lenslet that is valid in less than
/// half of the frames is taken out. Throws Failure if none is left.
ReferenceReport measure_reference_spots(FrameSource& source, const CentroidOptions& options,
                                        Sensor& sensor);

/// Returns how far above the sensor's dark the first frames of the source have their threshold T
/// under these options, level and all, in ADU; the median of at most 32. Window gains are those for
/// this T.
double find_frame_threshold_adu(FrameSource& source, const CentroidOptions& options,
                                const Sensor& sensor);

}  // namespace curlew
