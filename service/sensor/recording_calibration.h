// This file declares calibration on the frames of a recording, for `curlew calibrate` and for the
// daemon.
#pragma once

#include <string>

#include "acquisition/recording/frame_selection.h"
#include "acquisition/recording/mean_image.h"
#include "centroiding/calibration/calibrate.h"

namespace curlew {

/// What the frames of the reference beam tell.
struct ReferenceFrameSet {
  MeanImage mean;
  CalibrationInput input;  ///< without dark, flat and centroid options
};

/// Reads the frames of a recording, with optics and detector as its header has them. Pixels without
/// a number are bad. Throws Failure as read_mean_image() and FitsSource do.
ReferenceFrameSet read_reference_frames(const std::string& path, const FrameSelection& selection);

/// Sets the dark and its variance.
void set_dark(const MeanImage& dark, CalibrationInput& input);

struct RecordingCalibration {
  Calibration calibration;
  std::string dropped;  ///< a sentence on lenslets that were taken out; empty if there are none
};

/// Finds grid, windows and gains from the input, for the threshold that these frames need, and
/// measures the reference spots on all frames of the recording with the pipeline's own kernel.
/// Throws Failure as calibrate_sensor() and measure_reference_spots() do. name: what that calls the
/// frames.
RecordingCalibration calibrate_on_frames(const std::string& path, const FrameSelection& selection,
                                         CalibrationInput input, const std::string& name);

}  // namespace curlew
