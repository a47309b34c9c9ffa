// ExposureRule: which exposure a camera should have, by how bright its spots are.
#pragma once

#include <limits>
#include <optional>

namespace curlew {

struct ExposureLimits {
  /// The brightest spots are kept at this part of saturation.
  double target = 0.6;
  double min_us = 1.0;
  double max_us = std::numeric_limits<double>::infinity();
};

/// Follows the brightness of one camera. It changes nothing while the brightest of the last frames
/// lies from .6 to 1.35 times the target. At the start it answers within a few frames. Once the
/// brightness has been right, darkness must last for two seconds before the exposure grows, and
/// twice as long each time that the growth had to be taken back, up to a minute. So a source that
/// flickers sets the exposure by its bright moments and does not make it hunt. Too much light is
/// answered at once.
class ExposureRule {
 public:
  explicit ExposureRule(const ExposureLimits& limits) : limits_(limits) {}

  /// Looks at one frame: `brightness` is that of its brightest spots over the level, as a part of
  /// what the level leaves until saturation; `time_s` never falls. Returns the exposure to set, or
  /// nothing. Frames that were exposed before the change is done should not be shown to it; it
  /// ignores the first .15 s after one.
  std::optional<double> look(double time_s, double brightness, double exposure_us);

 private:
  std::optional<double> change(double time_s, double exposure_us, double factor);

  ExposureLimits limits_;
  double ignored_until_s_ = -std::numeric_limits<double>::infinity();
  double since_s_ = std::numeric_limits<double>::quiet_NaN();  ///< of the first frame that counts
  double right_since_s_ = std::numeric_limits<double>::quiet_NaN();
  double brightest_ = 0.0;  ///< of the frames since since_s_
  int saturated_ = 0;       ///< frames in a row
  bool settled_ = false;    ///< the brightness has been right
  double patience_s_ = 2.0;
  double grown_at_s_ = -std::numeric_limits<double>::infinity();
};

}  // namespace curlew
