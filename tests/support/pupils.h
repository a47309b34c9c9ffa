// These are masks of lenslets for tests.
#pragma once

#include <cmath>
#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include "core/image.h"

namespace curlew::testing {

using Mask = Image<std::uint8_t>;

inline Mask square_pupil(int n) { return Mask(n, n, 1); }

/// Has the lenslets whose centre lies between the inner and the outer radius (of the array's half
/// width).
inline Mask annular_pupil(int n, double inner, double outer = 1.0) {
  Mask mask(n, n, 0);
  const double centre = 0.5 * (n - 1);
  for (int r = 0; r < n; ++r)
    for (int c = 0; c < n; ++c) {
      const double radius = std::hypot(r - centre, c - centre) / (0.5 * n);
      mask(r, c) = radius <= outer && radius >= inner ? 1 : 0;
    }
  return mask;
}
inline Mask round_pupil(int n) { return annular_pupil(n, 0.0); }

/// Reads a mask in which '#' is a lenslet and anything else is none.
inline Mask pupil_from(const std::vector<std::string>& rows) {
  Mask mask(static_cast<int>(rows.size()), static_cast<int>(rows[0].size()), 0);
  for (int r = 0; r < mask.rows(); ++r)
    for (int c = 0; c < mask.cols(); ++c)
      mask(r, c) = rows[static_cast<std::size_t>(r)][static_cast<std::size_t>(c)] == '#' ? 1 : 0;
  return mask;
}

/// Removes each lenslet with the given probability; at least one is left.
inline Mask knock_out(Mask mask, double probability, std::mt19937& random) {
  std::bernoulli_distribution gone(probability);
  Mask left = mask;
  int count = 0;
  for (auto& v : left) {
    if (v != 0 && gone(random)) v = 0;
    count += v;
  }
  return count > 0 ? left : mask;
}

}  // namespace curlew::testing
