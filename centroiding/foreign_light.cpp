#include "centroiding/foreign_light.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <span>

#include "core/as_size.h"
#include "core/median.h"
#include "core/size_check.h"

namespace curlew {
namespace {

constexpr float kSigmaOfMedian = 1.4826F;
constexpr std::size_t kMaxSample = 64;  // The median of so many scatters by an eighth.

// The least light between the lenslets that is surely there: over T, which is 4 σ of a pixel, and
// over σ, where a corner is one pixel. More pixels lessen it by the root of their number.
constexpr float kOfThreshold = 0.825F;
constexpr float kOfNoise = 3.3F;
constexpr float kOfStep = 0.375F;  // of the step from one side to the other
// Such light pulls a spot by up to this part of its window's width, times that light over the
// spot's.
constexpr float kLever = 0.3F;
constexpr float kPulled_px = 0.05F;
constexpr float kOfSigma = 0.12F;  // Optics leave broad spots off anyway.
constexpr float kSigmas = 3.0F;    // of the spot's noise

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

/// Returns the light round a lenslet that the level does not have, or the step across it, in
/// counts.
float light_around(const FrameLevels& levels, std::size_t row, std::size_t col) noexcept {
  const std::size_t cols = as_size(levels.raw.cols());
  const float* upper = levels.corner.data() + row * (cols + 1) + col;
  const float* lower = upper + cols + 1;
  const std::size_t k = row * cols + col;
  return larger(levels.raw[k] - levels.level[k],
                kOfStep * larger(step({upper[0], lower[0]}, {upper[1], lower[1]}),
                                 step({upper[0], upper[1]}, {lower[0], lower[1]})));
}

// The two functions below look at whole rows. Their loops store nothing and have no branch, so that
// the compiler makes vectors of them.

/// Returns whether both of one side exceed both of the other by more than this.
int exceed(Pair one, Pair other, float by) noexcept {
  return (one.a - other.a > by ? 1 : 0) & (one.a - other.b > by ? 1 : 0) &
         (one.b - other.a > by ? 1 : 0) & (one.b - other.b > by ? 1 : 0);
}

/// Returns whether a lenslet of the row may have more than this round it.
bool is_lit_around(const FrameLevels& levels, std::size_t row, float least) noexcept {
  const std::size_t cols = as_size(levels.raw.cols());
  const float* raw = levels.raw.data() + row * cols;
  const float* level = levels.level.data() + row * cols;
  const float* upper = levels.corner.data() + row * (cols + 1);
  const float* lower = upper + cols + 1;
  int lit = 0;
  for (std::size_t c = 0; c < cols; ++c) lit |= raw[c] - level[c] > least ? 1 : 0;
  const float least_step = least / kOfStep;
  for (std::size_t c = 0; c < cols; ++c)
    lit |= exceed({upper[c + 1], lower[c + 1]}, {upper[c], lower[c]}, least_step) |
           exceed({upper[c], lower[c]}, {upper[c + 1], lower[c + 1]}, least_step);
  for (std::size_t c = 0; c < cols; ++c)
    lit |= exceed({lower[c], lower[c + 1]}, {upper[c], upper[c + 1]}, least_step) |
           exceed({upper[c], upper[c + 1]}, {lower[c], lower[c + 1]}, least_step);
  return lit != 0;
}

/// Spots that exceed the first and one of the others are unlike the rest.
struct UnlikeSpots {
  float brightest, widest_px2, longest_px2;
};

/// Returns whether there is one among lenslets [begin, end).
bool has_unlike(const Centroids& centroids, const Image<float>& reference_flux_adu,
                std::size_t begin, std::size_t end, const UnlikeSpots& than) noexcept {
  const float* flux = centroids.flux_adu.data();
  const float* reference = reference_flux_adu.data();
  const float* xx = centroids.xx_px2.data();
  const float* yy = centroids.yy_px2.data();
  const float* xy = centroids.xy_px2.data();
  const float brightest = than.brightest, widest = than.widest_px2, longest = than.longest_px2;
  int unlike = 0;
  for (std::size_t k = begin; k < end; ++k) {
    const int brighter = flux[k] > brightest * reference[k] ? 1 : 0;
    const int wider = xx[k] + yy[k] > widest ? 1 : 0;
    const int longer = std::abs(xx[k] - yy[k]) + 2.0F * std::abs(xy[k]) > longest ? 1 : 0;
    unlike |= brighter & (wider | longer);
  }
  return unlike != 0;
}

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
  const std::size_t cols = as_size(pull_.cols());
  const std::size_t corner_pixels = levels.values.size() / levels.corner.size();
  const float least =
      std::max(kOfThreshold * levels.threshold, kOfNoise * std::sqrt(levels.pixel_variance)) /
      std::sqrt(static_cast<float>(corner_pixels));
  const auto median = [&](const auto& value_of) {
    values_.clear();
    for (const std::size_t k : sample_)
      if (centroids.state[k] == LensletState::kValid) values_.push_back(value_of(k));
    return median_of(std::span(values_));
  };
  const float flux =
      median([&](std::size_t k) { return centroids.flux_adu[k] / reference_flux_adu_[k]; });
  const float width_px2 = median([&](std::size_t k) { return width_of(centroids, k); });
  const UnlikeSpots perhaps{flux + kBrighter * flux, width_px2 + kWider * width_px2,
                            kWider * width_px2};
  std::optional<Usual> most;  // It takes long to find, and hardly any frame needs it.

  const auto is_foreign = [&](std::size_t row, std::size_t k) {
    const float around = light_around(levels, row, k - row * cols);
    const float pull_px = pull_[k] * around;  // times the spot's light
    const float noise_px2 = centroids.variance_x_px2[k] + centroids.variance_y_px2[k];
    const float light = centroids.flux_adu[k];
    const float of_sigma_px2 = kOfSigma * kOfSigma * 0.5F * width_of(centroids, k);
    const float allowed_px2 =
        std::max({kPulled_px * kPulled_px, of_sigma_px2, kSigmas * kSigmas * noise_px2});
    const bool pulls = pull_px * pull_px > allowed_px2 * light * light;
    if (around > least && pulls) return true;
    return light > most->brightest * reference_flux_adu_[k] &&
           (width_of(centroids, k) > most->widest_px2 ||
            elongation_of(centroids, k) > most->longest_px2);
  };
  for (std::size_t row = 0; row < row_changed.size(); ++row) {
    const std::size_t first = row * cols;
    const auto holds = [&](const UnlikeSpots& spots) {
      return has_unlike(centroids, reference_flux_adu_, first, first + cols, spots);
    };
    const bool lit_around = is_lit_around(levels, row, least);
    if (!lit_around && !holds(perhaps)) continue;
    if (!most) most = usual(centroids);
    if (!lit_around && !holds({most->brightest, most->widest_px2, most->longest_px2})) continue;
    for (std::size_t k = first; k < first + cols; ++k) {
      if (centroids.state[k] != LensletState::kValid || !is_foreign(row, k)) continue;
      centroids.state[k] = LensletState::kLost;
      --centroids.n_valid;
      row_changed[row] = 1;
    }
  }
}

}  // namespace curlew
