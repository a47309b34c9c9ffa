#include "service/sensor/optics_comparison.h"

#include <spdlog/fmt/fmt.h>

#include <cmath>

namespace curlew {

std::string differing_optics(const Optics& recording, const Optics& other) {
  constexpr double kAgree = 1e-3;
  std::string text;
  const auto add = [&](const std::string& difference) {
    text.append(text.empty() ? "" : ", ").append(difference);
  };
  const auto compare = [&](const char* name, double a, double b, double unit, const char* symbol) {
    if (std::abs(a - b) > kAgree * std::abs(a))
      add(fmt::format("{} {:.5g}{} for {:.5g}", name, a / unit, symbol, b / unit));
  };
  compare("pitch", recording.pitch_m, other.pitch_m, 1e-6, " um");
  compare("focal length", recording.focal_m, other.focal_m, 1e-3, " mm");
  compare("pixel", recording.pixel_m, other.pixel_m, 1e-6, " um");
  compare("wavelength", recording.wavelength_m, other.wavelength_m, 1e-9, " nm");
  // A header that knows no optics does not know the relay either.
  if (std::isnan(recording.pitch_m)) return text;
  compare("magnification", recording.magnification, other.magnification, 1.0, "");
  if (recording.mirrored != other.mirrored)
    add(recording.mirrored ? "a mirrored relay" : "a relay that is not mirrored");
  return text;
}

}  // namespace curlew
