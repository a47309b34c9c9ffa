#include "centroiding/foreign_light.h"

#include <algorithm>
#include <cmath>
#include <span>

#include "core/as_size.h"
#include "core/median.h"
#include "core/size_check.h"

namespace curlew {
namespace {

constexpr float kSigmaOfMedian = 1.4826F;
constexpr std::size_t kMaxSample = 64;  // The median of so many scatters by an eighth.

// The least light between the lenslets that is surely there, over T, which is 4 σ; and over σ.
constexpr float kOfThreshold = 0.375F;
constexpr float kOfNoise = 1.5F;
// Such light pulls a spot by up to this part of its window's width, times that light over the
// spot's.
constexpr float kLever = 0.3F;
constexpr float kPulled_px = 0.05F;
constexpr float kSigmas = 3.0F;  // of the spot's noise

// A spot is brighter, wider or longer than the others if it is so by these parts of the median, and
// by so many robust standard deviations.
constexpr float kBrighter = 0.06F;
constexpr float kBrighterSigmas = 2.5F;
constexpr float kWider = 0.12F;
constexpr float kWiderSigmas = 6.0F;
constexpr float kLongerSigmas = 12.0F;  // Lengths are not negative, and their tails are long.

// std::max would be a branch on references.
float larger(float a, float b) noexcept { return a < b ? b : a; }
float smaller(float a, float b) noexcept { return a < b ? a : b; }

struct Pair {
  float a, b;
};
/// Returns by how much both of one side are brighter than both of the other.
float step(Pair one, Pair other) noexcept {
  return larger(smaller(one.a, one.b) - larger(other.a, other.b),
                smaller(other.a, other.b) - larger(one.a, one.b));
}

/// The second moments along both axes, px².
float width_of(const Centroids& centroids, std::size_t k) noexcept {
  return centroids.xx_px2[k] + centroids.yy_px2[k];
}

/// How long the spot is beyond its width, along the pixels' axes and across, px².
float elongation_of(const Centroids& centroids, std::size_t k) noexcept {
  return std::abs(centroids.xx_px2[k] - centroids.yy_px2[k]) + 2.0F * std::abs(centroids.xy_px2[k]);
}

struct Spread {
  float median;
  float sigma;
};

/// Reorders and changes the values.
Spread spread_of(std::span<float> values) noexcept {
  const float median = median_of(values);
  for (float& value : values) value = std::abs(value - median);
  return {median, kSigmaOfMedian * median_of(values)};
}

}  // namespace

ForeignLight::ForeignLight(const Sensor& sensor, const CentroidPlan& plan)
    : adu_per_count_(plan.adu_per_count),
      reference_flux_adu_(sensor.flux_adu),
      pull_(plan.spots.rows(), plan.spots.cols()) {
  std::vector<std::size_t> lenslets;
  for (std::size_t k = 0; k < plan.spots.size(); ++k) {
    const CentroidPlan::Spot& spot = plan.spots[k];
    if (spot.state == LensletState::kUnlit) continue;
    const auto w = static_cast<float>(spot.w), h = static_cast<float>(spot.h);
    // The position of a spot's core does not depend on light that is so faint.
    if (!(plan.core_threshold > 0.0F)) pull_[k] = kLever * std::max(w, h) * w * h * adu_per_count_;
    if (sensor.flux_adu[k] > 0.0F) lenslets.push_back(k);
  }
  const std::size_t stride = lenslets.size() / kMaxSample + 1;
  for (std::size_t i = 0; i < lenslets.size(); i += stride) sample_.push_back(lenslets[i]);
  values_.reserve(sample_.size());
}

ForeignLight::Usual ForeignLight::usual(const Centroids& centroids) noexcept {
  constexpr std::size_t kFewest = 12;
  const auto spread = [&](const auto& value_of) {
    values_.clear();
    for (const std::size_t k : sample_)
      if (centroids.state[k] == LensletState::kValid) values_.push_back(value_of(k));
    return spread_of(values_);
  };
  const Spread flux =
      spread([&](std::size_t k) { return centroids.flux_adu[k] / reference_flux_adu_[k]; });
  if (values_.size() < kFewest) return {INFINITY, INFINITY, INFINITY};
  const Spread width = spread([&](std::size_t k) { return width_of(centroids, k); });
  const Spread elongation = spread([&](std::size_t k) { return elongation_of(centroids, k); });
  const float surely_px2 = kWider * width.median;
  return {flux.median + std::max(kBrighterSigmas * flux.sigma, kBrighter * flux.median),
          width.median + std::max(kWiderSigmas * width.sigma, surely_px2),
          elongation.median + std::max(kLongerSigmas * elongation.sigma, surely_px2)};
}

void ForeignLight::mark(const FrameLevels& levels, Centroids& centroids,
                        std::vector<std::uint8_t>& row_changed) noexcept {
  check_size("ForeignLight", "centroids", size_of(centroids.state), size_of(pull_));
  const Usual most = usual(centroids);
  const float least =
      std::max(kOfThreshold * levels.threshold, kOfNoise * std::sqrt(levels.pixel_variance));
  const float* flux = centroids.flux_adu.data();
  const std::size_t cols = as_size(pull_.cols());
  const float* corner = levels.corner.data();
  const auto is_foreign = [&](std::size_t row, std::size_t col) {
    const std::size_t k = row * cols + col;
    const float* upper = corner + row * (cols + 1) + col;
    const float* lower = upper + cols + 1;
    const float around =
        larger(levels.raw[k] - levels.level[k],
               kOfThreshold * larger(step({upper[0], lower[0]}, {upper[1], lower[1]}),
                                     step({upper[0], upper[1]}, {lower[0], lower[1]})));
    const float pull_px = pull_[k] * around;  // times the spot's light
    const float noise_px2 = centroids.variance_x_px2[k] + centroids.variance_y_px2[k];
    const float allowed_px = flux[k] * kPulled_px;
    const int diffuse =
        static_cast<int>(around > least) & static_cast<int>(pull_px > allowed_px) &
        static_cast<int>(pull_px * pull_px > kSigmas * kSigmas * noise_px2 * flux[k] * flux[k]);
    const int brighter = static_cast<int>(flux[k] > most.brightest * reference_flux_adu_[k]);
    const int unlike = static_cast<int>(width_of(centroids, k) > most.widest_px2) |
                       static_cast<int>(elongation_of(centroids, k) > most.longest_px2);
    return diffuse | (brighter & unlike);
  };
  for (std::size_t row = 0; row < row_changed.size(); ++row) {
    int any = 0;
    for (std::size_t col = 0; col < cols; ++col)  // stores nothing, so that it is vectors
      any |= is_foreign(row, col);
    if (any == 0) continue;
    for (std::size_t col = 0; col < cols; ++col) {
      const std::size_t k = row * cols + col;
      if (centroids.state[k] != LensletState::kValid || is_foreign(row, col) == 0) continue;
      centroids.state[k] = LensletState::kLost;
      --centroids.n_valid;
      row_changed[row] = 1;
    }
  }
}

}  // namespace curlew
