#include "service/bench/field_light.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <vector>

namespace curlew {
namespace {

/// Returns the taps 0…n of the symmetric filter whose transform is that of the Gaussian, up to half
/// a cycle a pixel.
std::vector<float> gaussian_taps(double sigma_px) {
  constexpr int kFrequencies = 256;
  const int n = static_cast<int>(std::ceil(5.0 * sigma_px)) + 3;
  std::vector<float> taps(static_cast<std::size_t>(n) + 1);
  for (int k = 0; k <= n; ++k) {
    double sum = 0.0;
    for (int i = 0; i < kFrequencies; ++i) {
      const double w = std::numbers::pi * (i + 0.5) / kFrequencies;  // rad a pixel
      sum += std::exp(-0.5 * sigma_px * sigma_px * w * w) * std::cos(w * k);
    }
    taps[static_cast<std::size_t>(k)] = static_cast<float>(sum / kFrequencies);
  }
  return taps;
}

/// Filters along one axis: element i of line l is at i·step + l·line.
void filter_lines(const Image<float>& from, Image<float>& to, int lines, int n, std::ptrdiff_t line,
                  std::ptrdiff_t step, const std::vector<float>& taps) {
  const int reach = static_cast<int>(taps.size()) - 1;
  for (int l = 0; l < lines; ++l) {
    const float* in = from.data() + l * line;
    float* out = to.data() + l * line;
    for (int i = 0; i < n; ++i) {
      float sum = 0.0F;
      for (int k = std::max(-reach, -i); k <= std::min(reach, n - 1 - i); ++k)
        sum += taps[static_cast<std::size_t>(std::abs(k))] * in[(i + k) * step];
      out[i * step] = sum;
    }
  }
}

/// Returns the light of one square lenslet at a place in its window, interpolated between pixels.
float light_at(const Image<float>& light, int first_row, int first_col, int window, double x,
               double y) {
  const int col = static_cast<int>(std::floor(x));
  const int row = static_cast<int>(std::floor(y));
  if (col < 0 || row < 0 || col + 1 >= window || row + 1 >= window) return 0.0F;
  const auto u = static_cast<float>(x - col);
  const auto v = static_cast<float>(y - row);
  const float* above = &light(first_row + row, first_col + col);
  const float* below = &light(first_row + row + 1, first_col + col);
  return (1.0F - v) * ((1.0F - u) * above[0] + u * above[1]) +
         v * ((1.0F - u) * below[0] + u * below[1]);
}

constexpr double kFineSamples = 8.0;  // a λ/w

}  // namespace

Image<float> blurred(const Image<float>& light, double sigma_px) {
  const std::vector<float> taps = gaussian_taps(sigma_px);
  const int rows = light.rows();
  const int cols = light.cols();
  Image<float> along_x(rows, cols);
  Image<float> result(rows, cols);
  filter_lines(light, along_x, rows, cols, cols, 1, taps);
  filter_lines(along_x, result, cols, rows, 1, cols, taps);
  for (float& value : result) value = std::max(value, 0.0F);
  return result;
}

FieldParameters before_turning(const FieldParameters& parameters) {
  FieldParameters fine = parameters;
  fine.rotation_deg = 0.0;
  fine.samples_per_lambda_w = kFineSamples;
  const double side = parameters.window_px / parameters.samples_per_lambda_w * std::numbers::sqrt2;
  fine.window_px = 2 * static_cast<int>(std::ceil(0.5 * side * kFineSamples) + 1.0);
  return fine;
}

Image<float> turned(const Image<float>& light, const FieldParameters& parameters) {
  constexpr int kParts = 4;  // of a pixel along a side
  const FieldParameters fine = before_turning(parameters);
  const int side = parameters.window_px;
  const double scale = kFineSamples / parameters.samples_per_lambda_w;
  const double angle = parameters.rotation_deg * std::numbers::pi / 180.0;
  const double middle = 0.5 * (fine.window_px - 1);
  const auto share = static_cast<float>(scale * scale / (kParts * kParts));
  Image<float> result(parameters.rows * side, parameters.cols * side);
  for (int i = 0; i < result.rows(); ++i) {
    for (int j = 0; j < result.cols(); ++j) {
      float sum = 0.0F;
      for (int part = 0; part < kParts * kParts; ++part) {
        const double x = (j % side + (part % kParts + 0.5) / kParts - 0.5 * side) * scale;
        const int above = part / kParts;
        const double y = (i % side + (above + 0.5) / kParts - 0.5 * side) * scale;
        sum += light_at(light, i / side * fine.window_px, j / side * fine.window_px, fine.window_px,
                        middle + std::cos(angle) * x + std::sin(angle) * y,
                        middle + std::cos(angle) * y - std::sin(angle) * x);
      }
      result(i, j) = share * sum;
    }
  }
  return result;
}

}  // namespace curlew
