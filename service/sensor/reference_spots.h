// Reference spots: measured by the pipeline's own kernel, so that a calibration replays to zero.
#pragma once

#include <string>

#include "acquisition/frame_source.h"
#include "centroiding/centroid.h"
#include "centroiding/sensor.h"

namespace curlew {

struct ReferenceReport {
  int dropped = 0;   ///< lenslets taken out of the sensor
  std::string text;  ///< a sentence on them; empty where there is none
};

/// Runs find_centroids over all frames of the source and sets the sensor's references and fluxes
/// to the means over the frames in which the lenslet is valid. A lenslet that is not valid in at
/// least half of the frames is taken out. Failure where none is left.
ReferenceReport measure_reference_spots(FrameSource& source, const CentroidOptions& options,
                                        Sensor& sensor);

}  // namespace curlew
