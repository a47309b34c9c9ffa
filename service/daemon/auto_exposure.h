// AutoExposure keeps a camera's brightest spots at a part of saturation.
#pragma once

#include <chrono>
#include <functional>
#include <optional>
#include <string>

#include "acquisition/camera_options.h"
#include "core/optics.h"
#include "service/daemon/exposure_rule.h"
#include "service/page/frame_tap.h"

namespace curlew {

/// Looks at some frames beside the pipeline and follows their brightness by ExposureRule. One
/// thread calls it, but for the tap.
class AutoExposure {
 public:
  explicit AutoExposure(const CameraOptions& options)
      : options_(options),
        rule_({.target = options.exposure_target, .max_us = options.max_exposure_us}) {}

  /// The publisher's thread passes the frames here.
  FrameTap& tap() { return tap_; }

  /// What the camera does; both throw Failure as Camera does, or where none streams.
  struct Camera {
    std::function<double()> exposure_us;
    std::function<double(double)> set_exposure_us;
  };

  /// Looks at the frame that has passed since the last call, if one has; not while frames are
  /// recorded, unless the options allow it. Returns a sentence for the log where the exposure was
  /// changed or cannot be followed; each complaint comes once.
  std::string step(const Camera& camera, const Detector& detector, double pitch_px, bool recording);

 private:
  std::string follow(const FrameCopy& copy, const Camera& camera, const Detector& detector,
                     double pitch_px);

  CameraOptions options_;
  ExposureRule rule_;
  FrameTap tap_;
  std::string complaint_;  ///< the last one
  bool asked_ = false;
};

}  // namespace curlew
