#include "centroiding/calibration/optics_check.h"

#include <cmath>

#include "centroiding/calibration/sentence.h"
#include "core/error.h"

namespace curlew {
namespace {

constexpr double kRefused = 0.20;
constexpr double kWarned = 0.03;

bool contradicts(double ratio) { return std::abs(ratio - 1.0) > kRefused; }

}  // namespace

double expected_pitch_px(const Optics& optics) {
  return optics.pitch_m * optics.magnification / optics.pixel_m;
}

double diffraction_px(const Optics& optics, double found_pitch_px) {
  const double expected = expected_pitch_px(optics);
  const double px_per_m = contradicts(found_pitch_px / expected)
                              ? found_pitch_px / optics.pitch_m
                              : optics.magnification / optics.pixel_m;
  return optics.wavelength_m * optics.focal_m / optics.pitch_m * px_per_m;
}

std::vector<std::string> check_pitch(const Optics& optics, double found_pitch_px) {
  constexpr double kNearHalf = 0.15;
  const double expected = expected_pitch_px(optics);
  if (!(expected > 0.0)) return {};
  const double ratio = found_pitch_px / expected;
  const std::string seen =
      say("the pitch should be ", expected, " px by your numbers (--pitch-um, ",
          "--pixel-um, --magnification), found ", found_pitch_px, " px");
  const std::string remedy =
      say("check them; if all else is right, --magnification is ", optics.magnification * ratio);
  if (!contradicts(ratio)) {
    if (std::abs(ratio - 1.0) <= kWarned) return {};
    return {seen + ": " + remedy + ", unless the reference beam is curved"};
  }
  if (std::abs(2.0 * ratio - 1.0) <= kNearHalf) {
    return {seen + ": slopes are wrong by that factor unless you tell the relay or the binning; " +
            remedy};
  }
  throw Failure(seen + ": " + remedy);
}

std::vector<std::string> check_spot_width(const Optics& optics, double found_pitch_px,
                                          double width_over_diffraction) {
  constexpr double kImpossible = 0.5;
  constexpr double kNarrow = 0.8;
  constexpr double kWide = 4.0;
  constexpr double kWiderThanPixels = 1.5;
  if (std::isnan(width_over_diffraction)) return {};
  const double d = diffraction_px(optics, found_pitch_px);
  const std::string seen =
      say("the spots are ", width_over_diffraction, " times as wide as diffraction makes them (",
          "λ f / w is ", d, " px by your numbers)");
  if (width_over_diffraction < kImpossible && d > kWiderThanPixels) {
    throw Failure(seen + ": spots cannot be so narrow, so check --focal-mm, --wavelength-nm and " +
                  "--pitch-um");
  }
  if (width_over_diffraction < kNarrow) {
    return {seen + ", which is hardly possible: check --focal-mm and --wavelength-nm"};
  }
  if (width_over_diffraction > kWide) {
    return {seen + ": check focus, --focal-mm and --wavelength-nm"};
  }
  return {};
}

}  // namespace curlew
