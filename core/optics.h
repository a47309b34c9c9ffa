// Optics and Detector hold the constants that turn pixels into radians and ADU into electrons.
#pragma once

#include <limits>
#include <numbers>

namespace curlew {

inline constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

/// Describes the sensor's optics. Unknown values are NaN.
struct Optics {
  double pitch_m = kUnknown;       ///< lenslet pitch w
  double focal_m = kUnknown;       ///< lenslet focal length f
  double pixel_m = kUnknown;       ///< detector pixel p, as binned
  double wavelength_m = kUnknown;  ///< λ
  double magnification = 1.0;      ///< magnification m of a relay between lenslets and detector
  bool mirrored = false;  ///< the relay mirrors the image, so lenslet rows run up the detector

  /// Returns the slope, in rad per pitch, of a spot displaced by one pixel: 2π·w·p/(λ·f·m).
  double slope_rad_per_px() const {
    return 2.0 * std::numbers::pi * pitch_m * pixel_m / (wavelength_m * focal_m * magnification);
  }
};

/// Describes the detector. Unknown values are NaN.
struct Detector {
  double e_per_adu = kUnknown;
  double read_noise_e = kUnknown;
  double saturation_adu = kUnknown;  ///< ADU at and above which a pixel is saturated
  int bit_depth = 0;                 ///< 0 if unknown
};

}  // namespace curlew
