#include "centroiding/calibration/photon_transfer.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include "centroiding/calibration/spot_picture.h"

namespace curlew {
namespace {

struct Pixel {
  double light = 0.0;
  double variance = 0.0;
};

/// This is the typical variance of pixels of like light.
struct Level {
  double light = 0.0;
  double variance = 0.0;
  double relative_error = 0.0;  ///< of the variance
};

/// Returns the pixels that may be used. `clipped` becomes true where those at the lowest value are
/// many.
std::vector<Pixel> usable_pixels(const Image<float>& light, const Image<float>& variance,
                                 const Image<std::uint8_t>& bad, bool& clipped) {
  constexpr double kMany = 0.01;  // of all pixels
  constexpr double kClear = 4.0;  // standard deviations that keep a pixel clear of a limit
  std::vector<Pixel> pixels;
  for (std::size_t i = 0; i < light.size(); ++i) {
    if ((!bad.empty() && bad[i] != 0) || !std::isfinite(light[i]) || !std::isfinite(variance[i]))
      continue;
    pixels.push_back({static_cast<double>(light[i]), static_cast<double>(variance[i])});
  }
  std::vector<double> still;
  for (const Pixel& p : pixels)
    if (p.variance <= 0.0) still.push_back(p.light);
  if (static_cast<double>(still.size()) <= kMany * static_cast<double>(pixels.size()))
    return pixels;
  const auto [least, most] =
      std::minmax_element(pixels.begin(), pixels.end(),
                          [](const Pixel& a, const Pixel& b) { return a.light < b.light; });
  const double low = least->light;
  const double high = most->light;
  clipped = std::any_of(still.begin(), still.end(),
                        [&](double at) { return at <= low + 1e-3 * (high - low); });
  std::erase_if(pixels, [&](const Pixel& p) {
    const double clear = kClear * std::sqrt(p.variance);
    return p.variance <= 0.0 || p.light < low + clear || p.light > high - clear;
  });
  return pixels;
}

/// Sorts the pixels into bins of equal width in √light, in which photon noise is even.
std::vector<Level> levels_of(const std::vector<Pixel>& pixels, int frames) {
  constexpr std::size_t kBins = 32;
  constexpr std::size_t kMinPixels = 12;  // pixels in a bin
  if (pixels.size() < kMinPixels) return {};
  std::vector<float> lights;
  lights.reserve(pixels.size());
  for (const Pixel& p : pixels) lights.push_back(static_cast<float>(p.light));
  const double low = quantile(lights, 0.02);
  const double high = quantile(std::move(lights), 0.9995);
  if (!(high > low)) return {};
  std::vector<std::vector<float>> variances(kBins);
  std::vector<double> sums(kBins);
  for (const Pixel& p : pixels) {
    const double at = std::sqrt(std::clamp((p.light - low) / (high - low), 0.0, 1.0));
    const auto bin = std::min(static_cast<std::size_t>(at * kBins), kBins - 1);
    variances[bin].push_back(static_cast<float>(p.variance));
    sums[bin] += p.light;
  }
  std::vector<Level> levels;
  for (std::size_t bin = 0; bin < kBins; ++bin) {
    const auto n = static_cast<double>(variances[bin].size());
    if (variances[bin].size() < kMinPixels) continue;
    const double median = quantile(std::move(variances[bin]), 0.5);
    if (!(median > 0.0)) continue;
    // A median scatters by 1.25 times as much as a mean.
    levels.push_back({sums[bin] / n, median * mean_of_median_variance(frames),
                      1.25 * std::sqrt(2.0 / (frames - 1) / n)});
  }
  return levels;
}

struct Line {
  Eigen::VectorXd terms;  ///< of light⁰, light¹, …
  Eigen::VectorXd sigma;
};

/// Fits a polynomial of `n` terms to the levels. The errors are scaled by what the levels scatter
/// beyond their own.
Line fit(const std::vector<Level>& levels, int n) {
  constexpr double kModelError = 0.02;  // Bins are not so sure as their pixels are many.
  const auto rows = static_cast<Eigen::Index>(levels.size());
  const double unit = levels.back().light > 0.0 ? levels.back().light : 1.0;
  Line line;
  std::vector<double> expected;
  expected.reserve(levels.size());
  for (const Level& level : levels) expected.push_back(level.variance);
  for (int pass = 0; pass < 3; ++pass) {
    Eigen::MatrixXd a(rows, n);
    Eigen::VectorXd b(rows);
    for (Eigen::Index i = 0; i < rows; ++i) {
      const Level& level = levels[static_cast<std::size_t>(i)];
      const double sigma =
          expected[static_cast<std::size_t>(i)] * std::hypot(level.relative_error, kModelError);
      for (int k = 0; k < n; ++k) a(i, k) = std::pow(level.light / unit, k) / sigma;
      b(i) = level.variance / sigma;
    }
    const Eigen::MatrixXd inverse = (a.transpose() * a).inverse();
    line.terms = inverse * (a.transpose() * b);
    const double chi2 = (b - a * line.terms).squaredNorm() / static_cast<double>(rows - n);
    line.sigma = (inverse.diagonal() * std::max(chi2, 1.0)).cwiseSqrt();
    for (Eigen::Index i = 0; i < rows; ++i) {
      const Level& level = levels[static_cast<std::size_t>(i)];
      double value = 0.0;
      for (int k = 0; k < n; ++k) value += line.terms(k) * std::pow(level.light / unit, k);
      expected[static_cast<std::size_t>(i)] = std::max(value, 0.2 * level.variance);
    }
  }
  for (int k = 0; k < n; ++k) {
    line.terms(k) /= std::pow(unit, k);
    line.sigma(k) /= std::pow(unit, k);
  }
  return line;
}

}  // namespace

double mean_of_median_variance(int frames) {
  // This is the median of χ² (Wilson and Hilferty, Proc. Natl. Acad. Sci. 17, 684, 1931).
  const double k = std::max(frames - 1, 1);
  const double root = 1.0 - 2.0 / (9.0 * k);
  return 1.0 / (root * root * root);
}

PhotonTransfer measure_photon_transfer(const Image<float>& light_adu,
                                       const Image<float>& variance_adu2, int frames,
                                       const Image<std::uint8_t>& bad) {
  constexpr double kSure = 5.0;  // standard deviations
  constexpr std::size_t kMinPixelsLevels = 5;
  PhotonTransfer transfer;
  if (frames < 2 || variance_adu2.size() != light_adu.size()) return transfer;
  const std::vector<Pixel> pixels = usable_pixels(light_adu, variance_adu2, bad, transfer.clipped);
  const std::vector<Level> levels = levels_of(pixels, frames);
  if (levels.size() < kMinPixelsLevels) return transfer;
  Line line = fit(levels, 2);
  if (levels.size() > kMinPixelsLevels) {
    // Flicker and motion only add to the variance.
    const Line bent = fit(levels, 3);
    if (bent.terms(2) > kSure * bent.sigma(2)) line = bent;
  }
  if (line.terms(0) > 0.0) transfer.noise_adu = std::sqrt(line.terms(0));
  if (line.terms(1) > kSure * line.sigma(1)) transfer.e_per_adu = 1.0 / line.terms(1);
  return transfer;
}

}  // namespace curlew
