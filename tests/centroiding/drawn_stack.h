// DrawnStack draws stacks of frames of Gaussian spots with photon and read noise, in any unit, for
// tests.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <random>

#include "centroiding/calibration/calibrate.h"

namespace curlew {

/// Says what to draw: `count`×`count` spots on a square grid in the middle of a square frame, each
/// integrated over pixels.
struct DrawnStack {
  int side_px = 128;
  int count = 9;
  double pitch_px = 12.0;
  double sigma_px = 1.5;
  double shift_x_px = 0.0;
  double shift_y_px = 0.0;
  double electrons = 3000.0;  ///< in a spot
  double read_noise_e = 3.0;
  double bias_e = 100.0;
  double e_per_adu = 1.0;
  double step_adu = 0.0;     ///< values are rounded to multiples of it; 0 for none
  double lowest_adu = -1e9;  ///< values are clipped here
  double highest_adu = 1e9;
  int frames = 30;
  unsigned seed = 1;

  /// Returns the light in electrons, without noise and bias.
  Image<double> light() const {
    const auto part = [this](int pixel, double centre) {
      const double scale = sigma_px * std::sqrt(2.0);
      return 0.5 *
             (std::erf((pixel + 0.5 - centre) / scale) - std::erf((pixel - 0.5 - centre) / scale));
    };
    Image<double> light(side_px, side_px, 0.0);
    for (int i = 0; i < count; ++i) {
      for (int j = 0; j < count; ++j) {
        const double middle = 0.5 * (side_px - 1);
        const double x = middle + pitch_px * (j - 0.5 * (count - 1)) + shift_x_px;
        const double y = middle + pitch_px * (i - 0.5 * (count - 1)) + shift_y_px;
        const int reach = static_cast<int>(std::ceil(6.0 * sigma_px)) + 1;
        for (int r = std::max(static_cast<int>(y) - reach, 0);
             r < std::min(static_cast<int>(y) + reach + 1, side_px); ++r) {
          for (int c = std::max(static_cast<int>(x) - reach, 0);
               c < std::min(static_cast<int>(x) + reach + 1, side_px); ++c) {
            light(r, c) += electrons * part(r, y) * part(c, x);
          }
        }
      }
    }
    return light;
  }

  /// Returns mean and variance over the frames as calibration takes them, and no optics.
  CalibrationInput draw() const {
    std::mt19937 random(seed);
    std::normal_distribution<double> normal;
    const Image<double> expected = light();
    CalibrationInput input;
    input.reference_frames = frames;
    input.reference_adu = Image<float>(side_px, side_px);
    if (frames > 1) input.reference_variance_adu2 = Image<float>(side_px, side_px);
    for (std::size_t i = 0; i < expected.size(); ++i) {
      double sum = 0.0;
      double squares = 0.0;
      double first = 0.0;
      for (int k = 0; k < frames; ++k) {
        std::poisson_distribution<int> photons(expected[i] + 1e-12);
        double adu = (photons(random) + bias_e + read_noise_e * normal(random)) / e_per_adu;
        if (step_adu > 0.0) adu = step_adu * std::round(adu / step_adu);
        adu = std::clamp(adu, lowest_adu, highest_adu);
        if (k == 0) first = adu;
        sum += adu - first;
        squares += (adu - first) * (adu - first);
      }
      input.reference_adu[i] = static_cast<float>(first + sum / frames);
      if (frames > 1) {
        input.reference_variance_adu2[i] =
            static_cast<float>((squares - sum * sum / frames) / (frames - 1));
      }
    }
    return input;
  }
};

}  // namespace curlew
