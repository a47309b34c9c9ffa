// Which methods of detection suit a sensor. Calibration's verdict, `auto` and the refusal of a
// method all ask here.
#pragma once

#include <optional>
#include <string>

#include "centroiding/sensor.h"
#include "service/config.h"

namespace curlew {

/// Why a method does not suit a sensor.
struct Objection {
  std::string reason;  ///< half a sentence, as in "the pixels are coarse, 1.00 a lambda/w, and …"
  std::string remedy;
  bool refused = true;  ///< false: the method works, but worse than others
};

/// Returns what the sensor has against a method; nothing where it suits. kAuto suits every sensor.
std::optional<Objection> objection_to(DetectMethod method, const Sensor& sensor);

/// The method with which frames are looked at, and why it was chosen.
struct MethodChoice {
  DetectMethod method = DetectMethod::kCirculation;
  std::string why;  ///< half a sentence; empty where the configuration names the method
};

/// Returns the method of the configuration, or for kAuto the best that sensor and configuration
/// allow. docs/detection.md gives the figures behind it. Throws UsageError where the configuration
/// names a method that the sensor excludes.
MethodChoice choose_method(const Sensor& sensor, const Config& config);

/// Returns "method whitened, chosen by auto: …"; empty where nothing was chosen.
std::string method_line(const MethodChoice& choice);

/// Refuses settings of [detect] that have no effect on the method that the configuration names:
/// those that are not at their defaults. For kAuto nothing is refused, because the choice minds
/// them. Throws UsageError.
void refuse_settings_without_effect(const Config& config);

/// Returns the word of the configuration for a method.
std::string name_of(DetectMethod method);

}  // namespace curlew
