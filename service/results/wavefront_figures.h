// WavefrontFigures say in a few numbers how good a wavefront is.
#pragma once

#include "core/image.h"
#include "core/slope_field.h"

namespace curlew {

/// Of the phase at the centres of the valid lenslets, less its mean and its tilt, which are those
/// of the plane that fits best.
struct WavefrontFigures {
  double rms_rad = 0.0;
  double peak_to_valley_rad = 0.0;

  /// The Strehl ratio by Maréchal's exponential, exp(−rms²): good where rms is below 1 rad.
  double strehl() const;
};

/// Returns NaN for all where fewer than three lenslets are valid, or all lie in one line.
WavefrontFigures measure_wavefront(const Image<float>& phase_rad, const Image<std::uint8_t>& valid);

/// Returns the length in nm that a phase has at a wavelength; NaN where that is not known.
double nm_of(double rad, double wavelength_m);

}  // namespace curlew
