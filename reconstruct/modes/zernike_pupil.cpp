#include "reconstruct/modes/zernike_pupil.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace curlew {

ZernikePupil find_zernike_pupil(const Image<std::uint8_t>& valid) {
  constexpr double kSquare = 0.9;
  int top = valid.rows(), bottom = -1, left = valid.cols(), right = -1, lit = 0;
  for (int row = 0; row < valid.rows(); ++row)
    for (int col = 0; col < valid.cols(); ++col) {
      if (valid(row, col) == 0) continue;
      top = std::min(top, row);
      bottom = std::max(bottom, row);
      left = std::min(left, col);
      right = std::max(right, col);
      ++lit;
    }
  const double width = right - left + 1;
  const double height = bottom - top + 1;
  ZernikePupil pupil{0.5 * (left + right), 0.5 * (top + bottom), 0.5 * std::max(width, height),
                     0.0};
  if (lit > kSquare * width * height) pupil.radius = 0.5 * std::hypot(width, height);

  const auto distance = [&](int row, int col) { return std::hypot(col - pupil.x, row - pupil.y); };
  double nearest_lit = std::numeric_limits<double>::infinity();
  for (int row = top; row <= bottom; ++row)
    for (int col = left; col <= right; ++col)
      if (valid(row, col) != 0) nearest_lit = std::min(nearest_lit, distance(row, col));
  int hole = 0;
  for (int row = top; row <= bottom; ++row)
    for (int col = left; col <= right; ++col)
      if (valid(row, col) == 0 && distance(row, col) < nearest_lit) ++hole;
  pupil.obscuration = std::sqrt(hole / std::numbers::pi) / pupil.radius;
  return pupil;
}

}  // namespace curlew
