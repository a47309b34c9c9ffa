#include "service/bench/phase_strehl.h"

#include <array>
#include <cmath>
#include <complex>

namespace curlew {
namespace {

using Weights = std::array<float, 4>;

/// Returns the weights of the samples at −1, 0, 1 and 2 for a place t in [0, 1).
Weights cubic_weights(float t) {
  return {((-0.5F * t + 1.0F) * t - 0.5F) * t, (1.5F * t - 2.5F) * t * t + 1.0F,
          ((-1.5F * t + 2.0F) * t + 0.5F) * t, (0.5F * t - 0.5F) * t * t};
}
Weights linear_weights(float t) { return {0.0F, 1.0F - t, t, 0.0F}; }

/// Interpolates n values, which are `stride` apart, to m places. Beyond the ends f(−i) = 2f(0) −
/// f(i).
void interpolate(const float* from, int n, std::ptrdiff_t stride, const PhaseField& field,
                 Weights (*weights)(float), int m, float* to, std::ptrdiff_t to_stride) {
  const auto value = [&](int i) {
    if (i < 0) return 2.0F * from[0] - from[-i * stride];
    if (i >= n) return 2.0F * from[(n - 1) * stride] - from[(2 * n - 2 - i) * stride];
    return from[i * stride];
  };
  for (int j = 0; j < m; ++j) {
    const double at = field.coordinate(j);
    const int first = static_cast<int>(std::floor(at));
    const Weights w = weights(static_cast<float>(at - first));
    float sum = 0.0F;
    for (int i = 0; i < 4; ++i)
      if (w[static_cast<std::size_t>(i)] != 0.0F)
        sum += w[static_cast<std::size_t>(i)] * value(first - 1 + i);
    to[j * to_stride] = sum;
  }
}

/// Takes a map at lenslet centres to the field's points.
Image<float> on_field(const Image<float>& map, const PhaseField& field, Weights (*weights)(float)) {
  const int rows = field.values.rows();
  const int cols = field.values.cols();
  Image<float> along(map.rows(), cols);
  Image<float> out(rows, cols);
  for (int r = 0; r < map.rows(); ++r)
    interpolate(&map(r, 0), map.cols(), 1, field, weights, cols, &along(r, 0), 1);
  for (int c = 0; c < cols; ++c)
    interpolate(&along(0, c), map.rows(), cols, field, weights, rows, &out(0, c), cols);
  return out;
}

/// Returns the Strehl ratio after the phase was taken off. The field is float, but its sums are
/// double.
template <typename Phasor>
double strehl(const PhaseField& field, Phasor conjugate_phasor) {
  std::complex<double> sum;
  double amplitude = 0.0;
  for (int i = 0; i < field.values.rows(); ++i) {
    for (int j = 0; j < field.values.cols(); ++j) {
      sum += std::complex<double>(field.values(i, j) * conjugate_phasor(i, j));
      amplitude += static_cast<double>(std::abs(field.values(i, j)));
    }
  }
  return amplitude > 0.0 ? std::norm(sum) / (amplitude * amplitude) : 0.0;
}

}  // namespace

Strehl strehl_after(const PhaseField& field, const PhaseEstimate& estimate) {
  const Image<float> smooth = on_field(estimate.smooth, field, cubic_weights);
  const auto of_vortices = [&](int i, int j) {
    std::complex<float> product(1.0F, 0.0F);
    for (const PointVortex& v : estimate.vortices) {
      const std::complex<float> z(static_cast<float>(field.coordinate(j)) - v.x,
                                  static_cast<float>(field.coordinate(i)) - v.y);
      const float length = std::abs(z);
      if (length > 0.0F) product *= (v.charge > 0.0F ? std::conj(z) : z) / length;
    }
    return product;
  };
  Strehl result;
  result.ideal = strehl(
      field, [&](int i, int j) { return std::polar(1.0F, -smooth(i, j)) * of_vortices(i, j); });
  result.mirror = result.ideal;
  if (!estimate.vortices.empty()) {
    const Image<float> rotational = on_field(estimate.rotational, field, linear_weights);
    result.mirror = strehl(
        field, [&](int i, int j) { return std::polar(1.0F, -smooth(i, j) - rotational(i, j)); });
  }
  return result;
}

double strehl_uncorrected(const PhaseField& field) {
  return strehl(field, [](int, int) { return std::complex<float>(1.0F, 0.0F); });
}

}  // namespace curlew
