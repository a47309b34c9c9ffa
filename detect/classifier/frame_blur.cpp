#include "detect/classifier/frame_blur.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <numbers>

#include "core/as_size.h"
#include "core/spot_profile.h"
#include "detect/classifier/vortex_scout.h"

namespace curlew {
namespace {

// With coarser pixels, in px a λ/w, the core of a spot depends on where it lies on them.
constexpr double kLeastSampling = 1.4;

/// Returns the layer for features in the order of measure_many().
DenseLayer in_measured_order(const DenseLayer& layer) {
  DenseLayer ordered = layer;
  const auto outputs = as_size(layer.outputs);
  for (std::size_t i = 0; i < kSpotFeatures; ++i) {
    const std::size_t place = as_size(kMeasuredPlaces[i]);
    std::copy_n(layer.weights.data() + i * outputs, outputs,
                ordered.weights.data() + place * outputs);
  }
  return ordered;
}

/// Returns the distance between neighbours in a row of lenslets, px, and 0 where there are none.
double pitch_px(const Image<SpotWindow>& windows) {
  for (int row = 0; row < windows.rows(); ++row) {
    for (int col = 0; col + 1 < windows.cols(); ++col) {
      const SpotWindow& one = windows(row, col);
      const SpotWindow& next = windows(row, col + 1);
      if (one.w < 1 || next.w < 1) continue;
      return static_cast<double>(
          std::hypot(next.reference_x - one.reference_x, next.reference_y - one.reference_y));
    }
  }
  return 0.0;
}

/// Returns the variance of the core of a modelled spot between neighbours in (λ/w)², for pixels
/// anywhere on it.
double modelled_core_variance(const SensorTraits& traits, double pitch_px, double blur) {
  constexpr int kPlaces = 4;  // of the pixels
  const double d_px = 1.0 / traits.pixel;
  const SpotProfile profile(d_px, blur * d_px);
  const double reach_px = traits.reach * d_px;
  double sum = 0.0;
  for (int i = 0; i < kPlaces; ++i) {
    const double first = std::ceil(-reach_px) + static_cast<double>(i) / kPlaces;
    const int n = static_cast<int>(std::floor(reach_px - first)) + 1;
    sum += core_variance(profile, d_px, first, n, pitch_px) / (d_px * d_px);
  }
  return sum / kPlaces;
}

/// Returns the variance of a spot's core in (λ/w)², the mean of the two axes. A Hermite function
/// of order 0 is the weight of a core, and with orders 1 and 2 it makes x and x² times that weight.
double core_variance_of(const float* features) noexcept {
  const auto mode = [features](int m, int n) {
    const auto index = static_cast<std::size_t>(spot_mode_index({m, n}));
    return static_cast<double>(features[kMeasuredPlaces[index]]);
  };
  const double light = mode(0, 0);
  if (!(light > 0.0)) return std::numeric_limits<double>::quiet_NaN();
  const double x = mode(1, 0) / light;
  const double y = mode(0, 1) / light;
  const double squares =
      (mode(2, 0) + mode(0, 2)) / light / std::numbers::sqrt2 + 1.0 - 0.5 * (x * x + y * y);
  return 0.5 * kCoreWidth * kCoreWidth * squares;
}

}  // namespace

SpotCodings::SpotCodings(const DenseLayer& taught, const SpotCamera& camera, bool as_trained)
    : told_blur_(camera.blur_lambda_w) {
  SensorTraits traits = traits_of(camera);
  const auto add = [&](double blur) {
    traits.blur = blur;
    const DenseLayer layer = layer_for_sensor(taught, traits, camera.rotation_rad);
    codings_.push_back({as_trained ? layer : in_measured_order(layer), excess_spread(traits)});
  };
  add(told_blur_);
  for (int step = 1; step * kStep <= kTaughtBlur + 0.5 * kStep; ++step) add(step * kStep);
  if (camera.pixels_per_lambda_w < kLeastSampling) {
    core_variance_.fill(std::numeric_limits<double>::quiet_NaN());
    return;
  }
  const double pitch = pitch_px(camera.windows);
  for (int step = 0; step <= kSteps; ++step)
    core_variance_[as_size(step)] = modelled_core_variance(traits, pitch, step * kStep);
}

double SpotCodings::blur_of(double core_variance) const noexcept {
  if (std::isnan(core_variance)) return core_variance;
  const double* const above = std::upper_bound(
      core_variance_.data() + 1, core_variance_.data() + core_variance_.size() - 1, core_variance);
  const auto step = static_cast<double>(above - core_variance_.data());
  const double part = (core_variance - above[-1]) / (above[0] - above[-1]);
  // Blur widens by its square.
  const double square =
      (step - 1.0) * (step - 1.0) + std::clamp(part, 0.0, 1.0) * (2.0 * step - 1.0);
  return kStep * std::sqrt(square);
}

const SpotCoding* SpotCodings::find(double blur) const noexcept {
  // What turbulence, neighbours' light and noise do to cores is less.
  constexpr double kHardly = 0.03;  // (λ/w)²
  constexpr double kErrorOfBlur = 0.1;
  if (!(blur * blur > told_blur_ * told_blur_ + kHardly)) return codings_.data();
  if (blur > kTaughtBlur + kErrorOfBlur) return nullptr;
  const auto step = static_cast<std::size_t>(std::lround(blur / kStep));
  return &codings_[std::min(step, codings_.size() - 1)];
}

double typical_core_variance(const SpotFeatures& features, FrameView frame, const FrameShift& shift,
                             const Centroids& centroids, float mean_flux_adu,
                             float* buffer) noexcept {
  constexpr std::size_t kSpots = 24;
  constexpr std::size_t kFewest = 8;
  constexpr std::size_t kStride = 7919;  // a prime, so that all lenslets are visited
  std::array<std::int32_t, kSpots> chosen;
  std::size_t n = 0;
  const std::size_t size = centroids.state.size();
  for (std::size_t i = 0; i < size && n < kSpots; ++i) {
    const std::size_t k = i * kStride % size;
    if (is_missing(centroids.state[k]) || !(centroids.flux_adu[k] >= mean_flux_adu) ||
        !features.has_lenslet(k))
      continue;
    chosen[n++] = static_cast<std::int32_t>(k);
  }
  if (n < kFewest) return std::numeric_limits<double>::quiet_NaN();
  features.measure_many(frame, shift, chosen.data(), static_cast<int>(n), centroids.flux_adu.data(),
                        mean_flux_adu, buffer);
  std::array<double, kSpots> variances;
  std::size_t known = 0;
  for (std::size_t i = 0; i < n; ++i) {
    const double variance = core_variance_of(buffer + i * kSpotFeatures);
    if (std::isfinite(variance)) variances[known++] = variance;
  }
  if (known < kFewest) return std::numeric_limits<double>::quiet_NaN();
  double* const middle = variances.data() + known / 2;
  std::nth_element(variances.data(), middle, variances.data() + known);
  return *middle;
}

}  // namespace curlew
