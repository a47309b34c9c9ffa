// A LensletGrid says where the lenslets' spots lie on the detector.
#pragma once

#include <array>
#include <cmath>
#include <numbers>

namespace curlew {

/// Describes a regular square grid: pixel = origin + P·(col, row). det P is negative for a mirrored
/// relay, behind which lenslet rows run up the detector.
struct LensletGrid {
  int rows = 0;
  int cols = 0;
  double origin_x_px = 0.0;
  double origin_y_px = 0.0;
  double p11 = 1.0;  ///< dx/dcol
  double p12 = 0.0;  ///< dx/drow
  double p21 = 0.0;  ///< dy/dcol
  double p22 = 1.0;  ///< dy/drow

  /// Returns the detector position (x, y), in px, of a place in lenslet units.
  std::array<double, 2> pixel_from_lenslet(double col, double row) const {
    return {origin_x_px + p11 * col + p12 * row, origin_y_px + p21 * col + p22 * row};
  }
  /// Returns the place (col, row), in lenslet units, of a detector position in px.
  std::array<double, 2> lenslet_from_pixel(double x_px, double y_px) const {
    const double x = x_px - origin_x_px;
    const double y = y_px - origin_y_px;
    return {(p22 * x - p12 * y) / determinant(), (p11 * y - p21 * x) / determinant()};
  }
  double determinant() const { return p11 * p22 - p12 * p21; }
  double pitch_px() const { return std::sqrt(std::abs(determinant())); }
  /// Returns the angle of the column axis, from +x towards +y, in degrees.
  double rotation_deg() const { return std::atan2(p21, p11) * 180.0 / std::numbers::pi; }
};

}  // namespace curlew
