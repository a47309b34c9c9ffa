// DrawnSpots draws pictures of Gaussian spots on a known grid, for tests.
#pragma once

#include <cmath>
#include <cstdint>
#include <functional>
#include <numbers>
#include <random>

#include "core/image.h"
#include "core/lenslet_grid.h"

namespace curlew {

/// Says what to draw. The defaults are a round pupil that fills the frame, bright spots and little
/// noise.
struct DrawnSpots {
  int frame_rows = 256;
  int frame_cols = 256;
  double pitch_px = 16.0;
  double rotation_deg = 0.0;
  double angle_between_deg = 90.0;  ///< 60 for a hexagonal layout
  double stretch = 1.0;             ///< of the row vector
  bool mirrored = false;
  double centre_x_px = 127.3;  ///< position of lenslet (0, 0), in the middle of the frame
  double centre_y_px = 128.9;
  double sigma_px = 0.0;  ///< 0 for a sixth of the pitch, held within .8 and 3 px
  double peak_adu = 2000.0;
  double background_adu = 100.0;
  double noise_adu = 3.0;
  double brightness_spread = 0.0;  ///< peaks vary by exp(spread·N(0, 1))
  double jitter_px = 0.0;          ///< rms distance of spots from the grid, per axis
  std::uint32_t seed = 1;
  /// Returns whether a lenslet is lit, from its distance to the middle of the frame in px (x, y).
  std::function<bool(double, double)> lit = [](double, double) { return true; };

  /// Returns the grid, whose origin is the lenslet in the middle.
  LensletGrid grid() const {
    const double a = rotation_deg * std::numbers::pi / 180.0;
    const double b = a + angle_between_deg * std::numbers::pi / 180.0;
    LensletGrid g;
    g.origin_x_px = centre_x_px;
    g.origin_y_px = centre_y_px;
    g.p11 = pitch_px * std::cos(a);
    g.p21 = pitch_px * std::sin(a);
    g.p12 = stretch * pitch_px * std::cos(b) * (mirrored ? -1.0 : 1.0);
    g.p22 = stretch * pitch_px * std::sin(b) * (mirrored ? -1.0 : 1.0);
    return g;
  }

  /// Draws the picture. If `count` is given, it receives the number of spots whose centre is on the
  /// frame.
  Image<float> draw(int* count = nullptr) const {
    std::mt19937 random(seed);
    std::normal_distribution<double> normal;
    Image<float> image(frame_rows, frame_cols, static_cast<float>(background_adu));
    const LensletGrid g = grid();
    const double sigma = sigma_px > 0.0 ? sigma_px : std::min(std::max(pitch_px / 6.0, 0.8), 3.0);
    const int reach = static_cast<int>(frame_rows / pitch_px + frame_cols / pitch_px) + 2;
    int n = 0;
    for (int row = -reach; row <= reach; ++row) {
      for (int col = -reach; col <= reach; ++col) {
        auto [x, y] = g.pixel_from_lenslet(col, row);
        if (x < -0.5 || y < -0.5 || x >= frame_cols - 0.5 || y >= frame_rows - 0.5 ||
            !lit(x - centre_x_px, y - centre_y_px)) {
          continue;
        }
        ++n;
        const double peak = peak_adu * std::exp(brightness_spread * normal(random));
        x += jitter_px * normal(random);
        y += jitter_px * normal(random);
        const int r0 = std::max(static_cast<int>(y - 5.0 * sigma), 0);
        const int r1 = std::min(static_cast<int>(y + 5.0 * sigma) + 1, frame_rows - 1);
        const int c0 = std::max(static_cast<int>(x - 5.0 * sigma), 0);
        const int c1 = std::min(static_cast<int>(x + 5.0 * sigma) + 1, frame_cols - 1);
        for (int r = r0; r <= r1; ++r) {
          for (int c = c0; c <= c1; ++c) {
            const double d2 = (c - x) * (c - x) + (r - y) * (r - y);
            image(r, c) += static_cast<float>(peak * std::exp(-0.5 * d2 / (sigma * sigma)));
          }
        }
      }
    }
    for (float& value : image) value += static_cast<float>(noise_adu * normal(random));
    if (count != nullptr) *count = n;
    return image;
  }
};

/// Returns 40×40 lenslets of 6×6 px that fill the frame, with windows without gaps.
inline DrawnSpots drawn_without_gaps() {
  DrawnSpots drawn;
  drawn.frame_rows = 240;
  drawn.frame_cols = 240;
  drawn.pitch_px = 6.0;
  drawn.centre_x_px = 122.5;
  drawn.centre_y_px = 122.5;
  drawn.sigma_px = 1.0;
  return drawn;
}

}  // namespace curlew
