#include "service/method_choice.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/error.h"
#include "detect/classifier/frame_blur.h"
#include "service/setting_words.h"

namespace curlew {
namespace {

// What the network was shown, and what it was measured at: docs/lab/detection.md, "Outside the
// laboratory".
constexpr double kMinSampling = 0.9;  // px a λ/w
constexpr double kMaxSampling = 200.0;

/// Returns what speaks against the network. Turned lenslets do not: the spots are turned back.
std::optional<Objection> objection_to_classifier(const Sensor& sensor) {
  const double pixels_per_lambda_w =
      2.0 * std::numbers::pi / std::abs(sensor.optics.slope_rad_per_px());
  if (!(pixels_per_lambda_w < kMaxSampling)) {
    return Objection{fmt::format("lambda/w covers {:.1f} pixels", pixels_per_lambda_w),
                     "check the optics given to 'curlew calibrate'", false};
  }
  const double blur = sensor.spot_blur_px / pixels_per_lambda_w;
  if (blur > kTaughtBlur) {
    return Objection{
        fmt::format("the reference spots are blurred: by a Gaussian of {:.2f} lambda/w rms beyond "
                    "diffraction, and the classifier was taught up to {}, where its average "
                    "precision is .32",
                    blur, kTaughtBlur),
        "take the method whitened in [detect], or check the optics given to 'curlew calibrate'"};
  }
  if (pixels_per_lambda_w < kMinSampling) {
    return Objection{fmt::format("the pixels are coarse, {:.2f} a lambda/w, and the classifier "
                                 "was measured down to 1",
                                 pixels_per_lambda_w),
                     "take the method whitened in [detect]", false};
  }
  return std::nullopt;
}

/// Only the configuration can say that frames are as they were calibrated. Frames of telescopes are
/// not like their lamps', and the network was tried on two of them alone.
bool frames_are_as_calibrated(const Config& config) {
  return !config.centroid.follow_level && !config.centroid.follow_windows;
}

bool states_false_alarms(const DetectSettings& detect) {
  return detect.false_alarms_per_frame != DetectSettings{}.false_alarms_per_frame;
}

MethodChoice choose_best(const Sensor& sensor, const Config& config) {
  const DetectSettings defaults;
  if (config.detect.min_circulation_rad != defaults.min_circulation_rad ||
      config.detect.lobe_fraction != defaults.lobe_fraction) {
    return {DetectMethod::kCirculation,
            "[detect] min_circulation_rad and lobe_fraction act on it alone"};
  }
  if (const auto objection = objection_to(DetectMethod::kWhitened, sensor))
    return {DetectMethod::kCirculation, objection->reason};
  const std::string finds = "it finds more than circulation, with fewer false alarms";
  if (const auto objection = objection_to(DetectMethod::kClassifier, sensor))
    return {DetectMethod::kWhitened, finds + "; " + objection->reason};
  if (!frames_are_as_calibrated(config)) {
    return {DetectMethod::kWhitened,
            finds +
                "; the classifier would need frames as they were calibrated, and here level and "
                "spots are followed (it was tried on two frames of real skies alone)"};
  }
  if (states_false_alarms(config.detect))
    return {DetectMethod::kWhitened, finds + "; the classifier minds no rate of false alarms"};
  return {
      DetectMethod::kClassifier,
      "it finds more than whitened with every kind of spot that was measured: average precision "
      ".93 against .80 at 1000 photons, .86 against .72 where 5 % of the lenslets are dark"};
}

}  // namespace

std::optional<Objection> objection_to(DetectMethod method, const Sensor& sensor) {
  constexpr int kWhitenedLenslets = 4;
  if (method == DetectMethod::kClassifier) return objection_to_classifier(sensor);
  if (method == DetectMethod::kWhitened &&
      std::min(sensor.grid.rows, sensor.grid.cols) < kWhitenedLenslets) {
    return Objection{fmt::format("{} x {} lenslets have no 3 x 3 cells, at which whitened looks",
                                 sensor.grid.cols, sensor.grid.rows),
                     "take the method circulation in [detect]", false};
  }
  return std::nullopt;
}

MethodChoice choose_method(const Sensor& sensor, const Config& config) {
  const DetectMethod method = config.detect.method;
  if (method == DetectMethod::kAuto) return choose_best(sensor, config);
  const auto objection = objection_to(method, sensor);
  if (objection && objection->refused)
    throw UsageError(objection->reason + "; " + objection->remedy);
  return {method, {}};
}

std::string method_line(const MethodChoice& choice) {
  if (choice.why.empty()) return {};
  return "method " + name_of(choice.method) + ", chosen by auto: " + choice.why;
}

void refuse_settings_without_effect(const Config& config) {
  const DetectSettings& detect = config.detect;
  const DetectSettings defaults;
  const auto refuse = [&](const std::string& setting, const std::string& acts_on) {
    throw UsageError(setting + " has no effect on the method " + name_of(detect.method) +
                     ": it acts on " + acts_on + "; leave it out, or take another --method");
  };
  if (detect.method == DetectMethod::kAuto) return;
  if (detect.method == DetectMethod::kClassifier && states_false_alarms(detect))
    refuse("a rate of false alarms (--false-alarms, [detect] false_alarms_per_frame)",
           "circulation and whitened");
  if (detect.method != DetectMethod::kClassifier && detect.review != defaults.review)
    refuse("[detect] review", "the classifier");
  if (detect.method == DetectMethod::kCirculation) {
    if (detect.min_probability != defaults.min_probability)
      refuse("[detect] min_probability", "whitened and the classifier");
    return;
  }
  if (detect.min_circulation_rad != defaults.min_circulation_rad)
    refuse("[detect] min_circulation_rad", "circulation");
  if (detect.lobe_fraction != defaults.lobe_fraction)
    refuse("[detect] lobe_fraction", "circulation");
}

std::string name_of(DetectMethod method) {
  for (const auto& word : kDetectMethodWords)
    if (word.value == method) return std::string(word.text);
  return {};
}

}  // namespace curlew
