#include "detect/whitened/whitened_filter.h"

#include <algorithm>
#include <bit>
#include <cassert>

namespace curlew {
namespace {

constexpr float kLeastNoise_rad2 = 1e-20F;  // Nothing is divided by zero where there is no noise.
constexpr float kBrightFraction = 0.3F;     // of the mean flux; brighter lenslets tell the noise

// These take values and not references, because the compiler makes no vectors of a loop with
// std::max.
inline float larger(float a, float b) noexcept { return a < b ? b : a; }
inline float smaller(float a, float b) noexcept { return b < a ? b : a; }

// The polynomial is ln(1+t) on [0, 1), minimax to 7e-5. It is exact at t = 0 and, with ln 2, at t =
// 1.
inline float log_of(float x) noexcept {
  const auto bits = std::bit_cast<std::int32_t>(x);
  const auto exponent = static_cast<float>((bits >> 23) - 127);
  const float t = std::bit_cast<float>((bits & 0x7fffff) | 0x3f800000) - 1.0F;
  const float series =
      t *
      (0.99949556F + t * (-0.49190896F + t * (0.28947478F + t * (-0.13606275F + t * 0.03215845F))));
  return 0.69314718F * exponent + series;
}

/// Points to the rows of planes that a row of nodes takes. Of the lenslets it has only the nodes'
/// own.
struct NodeRow {
  NodeRow(const WhitenedPlanes& planes, int row) {
    for (int i = 0; i < 3; ++i) {
      const auto u = static_cast<std::size_t>(i);
      circulation[u] = &planes.circulation(row + i, 0);
      variance[u] = &planes.variance(row + i, 0);
      inverse[u] = &planes.inverse(row + i, 0);
    }
    upper = &planes.half_variance(row + 1, 1);
    lower = &planes.half_variance(row + 2, 1);
  }
  std::array<const float*, 3> circulation;
  std::array<const float*, 3> variance;
  std::array<const float*, 3> inverse;
  const float* upper;
  const float* lower;
};

/// Holds Σ⁻¹m, named by the cells' places.
struct Weights {
  float nw, n, ne, w, c, e, sw, s, se;
};

/// Returns Σ⁻¹m. Two cells have a covariance only if they share a lenslet across a corner; it is
/// minus half that lenslet's variance. Therefore Σ falls apart into two: the centre with the
/// corners, which is an arrow, and the four sides, which are a ring.
inline Weights solve(const NodeRow& row, const VortexPattern& m, std::size_t i) noexcept {
  const float h_nw = row.upper[i], h_ne = row.upper[i + 1];
  const float h_sw = row.lower[i], h_se = row.lower[i + 1];
  Weights x{};
  const float i_nw = row.inverse[0][i], i_ne = row.inverse[0][i + 2];
  const float i_sw = row.inverse[2][i], i_se = row.inverse[2][i + 2];
  const float schur = row.variance[1][i + 1] - ((h_nw * h_nw * i_nw + h_ne * h_ne * i_ne) +
                                                (h_sw * h_sw * i_sw + h_se * h_se * i_se));
  const float corners = (h_nw * i_nw + h_ne * i_ne) + (h_sw * i_sw + h_se * i_se);
  x.c = (m.centre + m.corner * corners) / schur;
  x.nw = (m.corner + h_nw * x.c) * i_nw;
  x.ne = (m.corner + h_ne * x.c) * i_ne;
  x.sw = (m.corner + h_sw * x.c) * i_sw;
  x.se = (m.corner + h_se * x.c) * i_se;

  const float i_n = row.inverse[0][i + 1], i_s = row.inverse[2][i + 1];
  const float ww = row.variance[1][i] - (h_nw * h_nw * i_n + h_sw * h_sw * i_s);
  const float ee = row.variance[1][i + 2] - (h_ne * h_ne * i_n + h_se * h_se * i_s);
  const float we = h_nw * h_ne * i_n + h_sw * h_se * i_s;
  const float to_w = m.side * (1.0F + h_nw * i_n + h_sw * i_s);
  const float to_e = m.side * (1.0F + h_ne * i_n + h_se * i_s);
  const float scale = 1.0F / (ww * ee - we * we);
  x.w = (ee * to_w + we * to_e) * scale;
  x.e = (ww * to_e + we * to_w) * scale;
  x.n = (m.side + h_nw * x.w + h_ne * x.e) * i_n;
  x.s = (m.side + h_sw * x.w + h_se * x.e) * i_s;
  return x;
}

inline float sum_of(const NodeRow& row, const Weights& x, std::size_t i) noexcept {
  const auto& d = row.circulation;
  return x.c * d[1][i + 1] +
         ((x.n * d[0][i + 1] + x.s * d[2][i + 1]) + (x.w * d[1][i] + x.e * d[1][i + 2])) +
         ((x.nw * d[0][i] + x.ne * d[0][i + 2]) + (x.sw * d[2][i] + x.se * d[2][i + 2]));
}

inline float information_of(const VortexPattern& m, const Weights& x) noexcept {
  return m.centre * x.c + m.side * ((x.n + x.s) + (x.w + x.e)) +
         m.corner * ((x.nw + x.ne) + (x.sw + x.se));
}

/// Returns wᵀΣw for white slopes of variance 1.
inline float white_variance(const Weights& x) noexcept {
  const float squares = x.c * x.c + ((x.n * x.n + x.s * x.s) + (x.w * x.w + x.e * x.e)) +
                        ((x.nw * x.nw + x.ne * x.ne) + (x.sw * x.sw + x.se * x.se));
  return 2.0F * squares - x.c * ((x.nw + x.ne) + (x.sw + x.se)) - (x.n + x.s) * (x.w + x.e);
}

/// Keeps eight partial sums side by side, so that the compiler makes vectors of them.
class LaneSum {
 public:
  /// Adds value(k) for k in [0, n).
  template <typename Value>
  float of(std::size_t n, Value value) noexcept {
    std::size_t k = 0;
    for (; k + kLanes <= n; k += kLanes)
      for (std::size_t i = 0; i < kLanes; ++i) lanes_[i] += value(k + i);
    for (; k < n; ++k) lanes_[0] += value(k);
    return ((lanes_[0] + lanes_[1]) + (lanes_[2] + lanes_[3])) +
           ((lanes_[4] + lanes_[5]) + (lanes_[6] + lanes_[7]));
  }

 private:
  static constexpr std::size_t kLanes = 8;
  std::array<float, kLanes> lanes_{};
};

float one_if(bool yes) noexcept { return yes ? 1.0F : 0.0F; }

void measure_brightness(const Image<float>& flux_adu, const Image<std::uint8_t>& lenslet_valid,
                        WhitenedPlanes& planes) noexcept {
  const float* flux = flux_adu.data();
  const std::uint8_t* valid = lenslet_valid.data();
  const float sum =
      LaneSum().of(flux_adu.size(), [&](std::size_t k) { return one_if(valid[k] != 0) * flux[k]; });
  const float n =
      LaneSum().of(flux_adu.size(), [&](std::size_t k) { return one_if(valid[k] != 0); });
  planes.mean_flux_adu = n > 0.0F ? sum / n : 0.0F;
  const float scale = planes.mean_flux_adu > 0.0F ? 1.0F / planes.mean_flux_adu : 0.0F;
  const auto cols = static_cast<std::size_t>(flux_adu.cols());
  for (int r = 0; r < flux_adu.rows(); ++r) {
    flux = &flux_adu(r, 0);
    valid = &lenslet_valid(r, 0);
    float* __restrict brightness = &planes.brightness(r + 1, 1);
    float* __restrict known = &planes.known(r + 1, 1);
    for (std::size_t c = 0; c < cols; ++c) known[c] = one_if(valid[c] != 0);
    for (std::size_t c = 0; c < cols; ++c)
      brightness[c] = known[c] * log_of(larger(flux[c] * scale, 0.0F) + kDarkest);
  }
}

/// Measures the noise of a slope of mean flux, from the bright lenslets.
void measure_noise(const SlopeField& slopes, const Image<float>& flux_adu,
                   WhitenedPlanes& planes) noexcept {
  const float minimum = kBrightFraction * planes.mean_flux_adu;
  const float* flux = flux_adu.data();
  const float* x = slopes.variance_x.data();
  const float* y = slopes.variance_y.data();
  const std::uint8_t* valid = slopes.valid.data();
  const auto bright = [&](std::size_t k) {
    return one_if(valid[k] != 0) * one_if(flux[k] > minimum);
  };
  const float sum = LaneSum().of(
      flux_adu.size(), [&](std::size_t k) { return bright(k) * (0.5F * (x[k] + y[k])) * flux[k]; });
  const float scale = LaneSum().of(flux_adu.size(), bright) * planes.mean_flux_adu;
  planes.noise_rad2 = scale > 0.0F ? std::min(sum / scale, kNoisiestSlope) : 0.0F;
}

void measure_lenslets(const SlopeField& slopes, const Image<float>& flux_adu, float clutter_rad2,
                      WhitenedPlanes& planes) noexcept {
  const float noise = planes.noise_rad2 * planes.mean_flux_adu;
  const float min_flux = std::max(noise / kNoisiestSlope, 1e-30F);
  const auto cols = static_cast<std::size_t>(slopes.cols());
  for (int r = 0; r < slopes.rows(); ++r) {
    const float* x = &slopes.x(r, 0);
    const float* y = &slopes.y(r, 0);
    const float* flux = &flux_adu(r, 0);
    const std::uint8_t* valid = &slopes.valid(r, 0);
    float* __restrict main = &planes.main(r + 1, 1);
    float* __restrict anti = &planes.anti(r + 1, 1);
    float* __restrict half = &planes.half_variance(r + 1, 1);
    for (std::size_t c = 0; c < cols; ++c) half[c] = valid[c] != 0 ? 1.0F : 0.0F;
    for (std::size_t c = 0; c < cols; ++c) {
      const float have = 0.5F * half[c];
      main[c] = have * (x[c] - y[c]);
      anti[c] = have * (x[c] + y[c]);
      half[c] = have * (noise / larger(flux[c], min_flux) + clutter_rad2) +
                (0.5F - have) * (kNoisiestSlope + clutter_rad2);
    }
  }
}

void measure_cells(WhitenedPlanes& planes) noexcept {
  const auto cols = static_cast<std::size_t>(planes.circulation.cols());
  for (int r = 0; r < planes.circulation.rows(); ++r) {
    const float* upper_main = &planes.main(r, 0);
    const float* lower_main = &planes.main(r + 1, 0);
    const float* upper_anti = &planes.anti(r, 0);
    const float* lower_anti = &planes.anti(r + 1, 0);
    const float* upper = &planes.half_variance(r, 0);
    const float* lower = &planes.half_variance(r + 1, 0);
    float* __restrict circulation = &planes.circulation(r, 0);
    float* __restrict variance = &planes.variance(r, 0);
    float* __restrict inverse = &planes.inverse(r, 0);
    for (std::size_t c = 0; c < cols; ++c) {
      circulation[c] = (upper_main[c] - lower_main[c + 1]) + (upper_anti[c + 1] - lower_anti[c]);
    }
    for (std::size_t c = 0; c < cols; ++c) {
      const float sum = (upper[c] + upper[c + 1]) + (lower[c] + lower[c + 1]);
      variance[c] = sum;
      inverse[c] = 1.0F / sum;
    }
  }
}

void measure_darkness(WhitenedPlanes& planes) noexcept {
  const auto cols = static_cast<std::size_t>(planes.darkness.cols());
  for (int r = 0; r < planes.darkness.rows(); ++r) {
    const float* b0 = &planes.brightness(r, 0);
    const float* b1 = &planes.brightness(r + 1, 0);
    const float* b2 = &planes.brightness(r + 2, 0);
    const float* b3 = &planes.brightness(r + 3, 0);
    const float* k0 = &planes.known(r, 0);
    const float* k1 = &planes.known(r + 1, 0);
    const float* k2 = &planes.known(r + 2, 0);
    const float* k3 = &planes.known(r + 3, 0);
    float* __restrict darkness = &planes.darkness(r, 0);
    for (std::size_t c = 0; c < cols; ++c) {
      const float own = (b1[c + 1] + b1[c + 2]) + (b2[c + 1] + b2[c + 2]);
      const float n_own = (k1[c + 1] + k1[c + 2]) + (k2[c + 1] + k2[c + 2]);
      const float round = ((b0[c + 1] + b0[c + 2]) + (b1[c] + b1[c + 3])) +
                          ((b2[c] + b2[c + 3]) + (b3[c + 1] + b3[c + 2]));
      const float n_round = ((k0[c + 1] + k0[c + 2]) + (k1[c] + k1[c + 3])) +
                            ((k2[c] + k2[c + 3]) + (k3[c + 1] + k3[c + 2]));
      const float have = smaller(smaller(n_own, n_round), 1.0F);
      darkness[c] = have * (round / larger(n_round, 1.0F) - own / larger(n_own, 1.0F));
    }
  }
}

}  // namespace

float quick_log(float x) noexcept { return log_of(x); }

WhitenedPlanes::WhitenedPlanes(int lenslet_rows, int lenslet_cols)
    : main(lenslet_rows + 2, lenslet_cols + 2),
      anti(lenslet_rows + 2, lenslet_cols + 2),
      half_variance(lenslet_rows + 2, lenslet_cols + 2, 0.5F * kNoisiestSlope),
      brightness(lenslet_rows + 2, lenslet_cols + 2),
      known(lenslet_rows + 2, lenslet_cols + 2),
      circulation(lenslet_rows + 1, lenslet_cols + 1),
      variance(lenslet_rows + 1, lenslet_cols + 1),
      inverse(lenslet_rows + 1, lenslet_cols + 1),
      darkness(lenslet_rows - 1, lenslet_cols - 1),
      first_t_squared(lenslet_rows - 1, lenslet_cols - 1) {}

void fill_planes(const SlopeField& slopes, const Image<float>& flux_adu,
                 const Image<std::uint8_t>& lenslet_valid, float clutter_rad2,
                 WhitenedPlanes& planes) noexcept {
  assert(flux_adu.rows() == slopes.rows() && flux_adu.cols() == slopes.cols());
  assert(planes.main.rows() == slopes.rows() + 2 && planes.main.cols() == slopes.cols() + 2);
  measure_brightness(flux_adu, lenslet_valid, planes);
  measure_noise(slopes, flux_adu, planes);
  measure_lenslets(slopes, flux_adu, clutter_rad2, planes);
  measure_cells(planes);
}

void look_over(const FirstLook& look, WhitenedPlanes& planes) noexcept {
  measure_darkness(planes);
  const FirstLook l = look;
  const float noise_rad2 = planes.noise_rad2;
  const auto cols = static_cast<std::size_t>(planes.darkness.cols());
  for (int r = 0; r < planes.darkness.rows(); ++r) {
    const NodeRow row(planes, r);
    const float* darkness = &planes.darkness(r, 0);
    float* __restrict first_t_squared = &planes.first_t_squared(r, 0);
    for (std::size_t c = 0; c < cols; ++c) {
      const Weights x = solve(row, l.pattern, c);
      const float sum = sum_of(row, x, c);
      const float information = information_of(l.pattern, x);
      const float noise = noise_rad2 * white_variance(x);
      const float min_z = larger(
          l.offset - l.per_darkness * darkness[c] + l.per_log_information * log_of(information),
          0.0F);
      const float square = sum * sum;
      const float t_squared = square / larger(noise, kLeastNoise_rad2);
      first_t_squared[c] = square - min_z * min_z * information >= 0.0F ? t_squared : -1.0F;
    }
  }
}

NodeFilter filter_at(const WhitenedPlanes& planes, const VortexPattern& pattern, int row,
                     int col) noexcept {
  const NodeRow rows(planes, row);
  const auto i = static_cast<std::size_t>(col);
  const Weights x = solve(rows, pattern, i);
  return {{x.nw, x.n, x.ne, x.w, x.c, x.e, x.sw, x.s, x.se},
          sum_of(rows, x, i),
          information_of(pattern, x)};
}

float noise_variance(const SlopeField& slopes, const NodeFilter& filter, int row,
                     int col) noexcept {
  // These are the weights of `main` and `anti` of the 4×4 lenslets (i, j) round the node: the
  // weight of the cell in which each counts positive, less that of the cell in which it counts
  // negative.
  const auto weight = [&](int i, int j) {
    if (i < 0 || i > 2 || j < 0 || j > 2) return 0.0F;
    return filter.weights[3 * static_cast<std::size_t>(i) + static_cast<std::size_t>(j)];
  };
  float variance = 0.0F;
  for (int i = 0; i < 4; ++i) {
    for (int j = 0; j < 4; ++j) {
      const int r = row + i - 1;
      const int c = col + j - 1;
      if (!slopes.valid.contains(r, c) || slopes.valid(r, c) == 0) continue;
      const float main = weight(i, j) - weight(i - 1, j - 1);
      const float anti = weight(i, j - 1) - weight(i - 1, j);
      const float x = main + anti;  // twice the weight of s_x
      const float y = anti - main;  // twice the weight of s_y
      variance += 0.25F * (x * x * slopes.variance_x(r, c) + y * y * slopes.variance_y(r, c)) +
                  0.5F * x * y * slopes.covariance_xy(r, c);
    }
  }
  return variance;
}

}  // namespace curlew
