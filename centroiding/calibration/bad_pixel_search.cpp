#include "centroiding/calibration/bad_pixel_search.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

#include "centroiding/calibration/spot_picture.h"
#include "centroiding/pixel_response.h"

namespace curlew {
namespace {

constexpr double kFarOff = 8.0;         // robust standard deviations
constexpr double kSigmaOfMad = 1.4826;  // of a normal distribution

std::vector<float> finite_of(const Image<float>& image) {
  std::vector<float> values;
  for (const float v : image)
    if (std::isfinite(v)) values.push_back(v);
  return values;
}

/// Returns the median of the finite values within two pixels; NaN where there are none.
float median_round(const Image<float>& image, int row, int col) {
  constexpr int kReach = 2;
  constexpr std::size_t kSide = 2 * kReach + 1;
  std::array<float, kSide * kSide> values{};
  std::ptrdiff_t n = 0;
  for (int r = std::max(row - kReach, 0); r <= std::min(row + kReach, image.rows() - 1); ++r)
    for (int c = std::max(col - kReach, 0); c <= std::min(col + kReach, image.cols() - 1); ++c)
      if (std::isfinite(image(r, c))) values[static_cast<std::size_t>(n++)] = image(r, c);
  if (n == 0) return std::nanf("");
  std::nth_element(values.begin(), values.begin() + n / 2, values.begin() + n);
  return values[static_cast<std::size_t>(n / 2)];
}

/// Returns what each pixel has above the median round it.
Image<float> above_neighbourhood(const Image<float>& image) {
  Image<float> above(image.rows(), image.cols());
  for (int r = 0; r < image.rows(); ++r)
    for (int c = 0; c < image.cols(); ++c) above(r, c) = image(r, c) - median_round(image, r, c);
  return above;
}

/// Returns the scatter of values round their median, without regard to the few that are far off.
/// Rounded values may all be alike; then it is half of the smallest difference that there is.
double robust_sigma(const std::vector<float>& values) {
  const auto median = static_cast<float>(quantile(values, 0.5));
  std::vector<float> distances;
  double smallest = INFINITY;
  for (const float v : values) {
    distances.push_back(std::abs(v - median));
    if (distances.back() > 0.0F)
      smallest = std::min(smallest, static_cast<double>(distances.back()));
  }
  const double sigma = kSigmaOfMad * quantile(std::move(distances), 0.5);
  return sigma > 0.0 ? sigma : 0.5 * smallest;
}

/// Marks pixels that `is_bad` says and that are not marked yet. Returns how many.
template <typename IsBad>
int mark(Image<std::uint8_t>& map, const IsBad& is_bad) {
  int n = 0;
  for (std::size_t i = 0; i < map.size(); ++i) {
    if (map[i] != 0 || !is_bad(i)) continue;
    map[i] = 1;
    ++n;
  }
  return n;
}

/// The standard deviation of `frames` normal values scatters by itself by 1/√(2(n−1)).
int mark_noisy(Image<std::uint8_t>& map, const Image<float>& variance_adu2, int frames) {
  Image<float> noise = variance_adu2;
  for (float& v : noise) v = std::sqrt(v);
  const std::vector<float> values = finite_of(noise);
  const double typical = quantile(values, 0.5);
  const double scatter = std::max(robust_sigma(values), typical / std::sqrt(2.0 * (frames - 1)));
  const double most = typical + kFarOff * scatter;
  return mark(map, [&](std::size_t i) { return static_cast<double>(noise[i]) > most; });
}

}  // namespace

BadPixels find_bad_pixels(const Image<float>& dark_adu, const Image<float>& variance_adu2,
                          int frames, const Image<float>& flat) {
  constexpr int kLeastFrames = 5;
  BadPixels bad;
  bad.map = Image<std::uint8_t>(dark_adu.rows(), dark_adu.cols());
  bad.no_number = mark(bad.map, [&](std::size_t i) { return !std::isfinite(dark_adu[i]); });
  const Image<float> above = above_neighbourhood(dark_adu);
  const double most = kFarOff * robust_sigma(finite_of(above));
  bad.hot =
      mark(bad.map, [&](std::size_t i) { return std::abs(static_cast<double>(above[i])) > most; });
  if (frames >= kLeastFrames && !variance_adu2.empty())
    bad.noisy = mark_noisy(bad.map, variance_adu2, frames);
  if (!flat.empty()) {
    const Image<std::uint8_t> dead = find_dead_pixels(flat);
    bad.dead = mark(bad.map, [&](std::size_t i) { return dead[i] != 0; });
  }
  return bad;
}

Image<std::uint8_t> find_dead_pixels(const Image<float>& flat) {
  constexpr float kOfNeighbours = 0.5F;
  Image<std::uint8_t> dead = find_unresponsive_pixels(flat);
  for (int r = 0; r < flat.rows(); ++r)
    for (int c = 0; c < flat.cols(); ++c)
      if (flat(r, c) < kOfNeighbours * median_round(flat, r, c)) dead(r, c) = 1;
  return dead;
}

}  // namespace curlew
