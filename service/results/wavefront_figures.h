// WavefrontFigures say in a few numbers how good a wavefront is.
#pragma once

#include "core/image.h"
#include "core/slope_field.h"

namespace curlew {

/// Of the wavefront at the centres of the valid lenslets, less its mean and its tilt, which are
/// those of the plane that fits best.
struct WavefrontFigures {
  double rms_rad = 0.0;
  double peak_to_valley_rad = 0.0;

  /// The Strehl ratio by Maréchal's exponential, exp(−rms²): good where rms is below 1 rad.
  double strehl() const;
};

/// Takes a phase of the split, [rows, cols]. Returns NaN for all where fewer than three lenslets
/// are valid, or all lie in one line.
///
/// The split's phase at a lenslet is the mean of its four corners', and corners are tied by means
/// over lenslets. A wave of k rad a pitch has 1 − (5/48)·k² of its height in it, on the average
/// over the wave's directions and to the order k³, so that (5/48) of the phase's Laplacian is taken
/// off.
WavefrontFigures measure_wavefront(const Image<float>& phase_rad, const Image<std::uint8_t>& valid);

/// Returns the length in nm that a phase has at a wavelength; NaN where that is not known.
double nm_of(double rad, double wavelength_m);

}  // namespace curlew
