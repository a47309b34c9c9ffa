#include "service/daemon/exposure_rule.h"

#include <algorithm>
#include <cmath>

namespace curlew {
namespace {

constexpr double kSaturated = 0.95;
constexpr double kTooBright = 1.35;  // times the target
constexpr double kTooDark = 0.6;
constexpr double kSaturatedFactor = 0.2;  // How much too bright it is cannot be seen.
constexpr double kLargestFactor = 10.0;
constexpr double kIgnored_s = 0.15;
constexpr double kQuick_s = 0.2;  // before the brightness has been right
constexpr double kSettling_s = 0.5;
constexpr double kLongestPatience_s = 60.0;
constexpr double kTakenBack_s = 10.0;

}  // namespace

std::optional<double> ExposureRule::look(double time_s, double brightness, double exposure_us) {
  if (time_s < ignored_until_s_ || !std::isfinite(brightness)) return {};
  if (std::isnan(since_s_)) {
    since_s_ = time_s;
    brightest_ = 0.0;
  }
  brightest_ = std::max(brightest_, brightness);
  saturated_ = brightness >= kSaturated ? saturated_ + 1 : 0;
  if (saturated_ >= 2) return change(time_s, exposure_us, kSaturatedFactor);

  const double looked_s = time_s - since_s_;
  const double part = brightest_ / limits_.target;
  const bool right = part >= kTooDark && part <= kTooBright;
  if (!right) right_since_s_ = std::numeric_limits<double>::quiet_NaN();
  if (part > kTooBright && looked_s >= kQuick_s) return change(time_s, exposure_us, 1.0 / part);
  if (part < kTooDark && looked_s >= (settled_ ? patience_s_ : kQuick_s))
    return change(time_s, exposure_us, std::min(1.0 / std::max(part, 1e-6), kLargestFactor));
  if (!right) return {};
  if (std::isnan(right_since_s_)) right_since_s_ = time_s;
  settled_ |= time_s - right_since_s_ >= kSettling_s;
  // The brightest of the past is forgotten after a while.
  if (looked_s >= patience_s_) since_s_ = std::numeric_limits<double>::quiet_NaN();
  return {};
}

/// Starts to look anew, and returns the exposure within the limits, or nothing if it is there.
std::optional<double> ExposureRule::change(double time_s, double exposure_us, double factor) {
  since_s_ = right_since_s_ = std::numeric_limits<double>::quiet_NaN();
  saturated_ = 0;
  const double wanted = std::clamp(factor * exposure_us, limits_.min_us, limits_.max_us);
  if (std::abs(wanted - exposure_us) <= 1e-3 * exposure_us) return {};
  if (factor > 1.0) {
    grown_at_s_ = time_s;
  } else if (settled_ && time_s - grown_at_s_ < kTakenBack_s + patience_s_) {
    patience_s_ = std::min(2.0 * patience_s_, kLongestPatience_s);
  }
  ignored_until_s_ = time_s + kIgnored_s;
  return wanted;
}

}  // namespace curlew
