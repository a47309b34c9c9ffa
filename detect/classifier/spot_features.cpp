#include "detect/classifier/spot_features.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <cstdint>
#include <string>

#include "core/error.h"

namespace curlew {
namespace {

constexpr double kModeWidth = 0.6;  // λ/w
constexpr double kReach = 1.75;     // λ/w
constexpr double kDark = 0.01;      // of the mean flux: fainter is all the same

/// Orthonormal Hermite functions, order by order.
double hermite_function(int order, double x) {
  double before = 0.0;
  double value = std::exp(-0.5 * x * x);
  for (int k = 1; k <= order; ++k) {
    const double next = std::sqrt(2.0 / k) * x * value - std::sqrt((k - 1.0) / k) * before;
    before = value;
    value = next;
  }
  return value;
}

}  // namespace

SpotMode spot_mode(int index) {
  int order = 0;
  while (index > order) index -= ++order;
  return {index, order - index};
}

int spot_mode_index(SpotMode mode) {
  const int order = mode.m + mode.n;
  return order * (order + 1) / 2 + mode.m;
}

constexpr std::array<int, kSpotFeatures> kMeasuredPlaces = [] {
  std::array<int, kSpotFeatures> places{};
  int i = 0;
  for (int order = 0; order < kProjectionOrders; ++order) {
    for (int m = 0; m <= order; ++m, ++i) {
      const int n = order - m;  // after n rows of kProjectionOrders and fewer
      places[static_cast<std::size_t>(i)] = n * kProjectionOrders - n * (n - 1) / 2 + m;
    }
  }
  for (; i < kSpotFeatures; ++i) places[static_cast<std::size_t>(i)] = i;
  return places;
}();

SpotFeatures::SpotFeatures(const SpotCamera& camera, const FrameFormat& format)
    : spots_(camera.windows.rows(), camera.windows.cols()),
      pixel_type_(format.pixel_type),
      noise_known_(camera.e_per_adu > 0.0),
      row_sign_(camera.rows_run_up ? -1.0F : 1.0F) {
  if (!(camera.pixels_per_lambda_w > 0.2 && camera.pixels_per_lambda_w < 200.0)) {
    throw Failure("λ/w covers " + std::to_string(camera.pixels_per_lambda_w) +
                  " pixels of the detector, which no classifier can use; check the optics");
  }
  if (format.cols < kProjectionLanes) {
    throw Failure("a frame of " + std::to_string(format.cols) +
                  " columns is too narrow for the classifier, which reads " +
                  std::to_string(kProjectionLanes) + " at once; take another detection method");
  }
  const double e_per_adu = noise_known_ ? camera.e_per_adu : 1.0;
  e_per_adu_ = static_cast<float>(e_per_adu);
  e_per_count_ = static_cast<float>(e_per_adu * format.scale_adu);
  const auto counts = [&](double adu) {
    return static_cast<float>((adu - format.zero_adu) / format.scale_adu);
  };
  background_counts_ = counts(camera.background_adu);
  if (!camera.dark_adu.empty() || !camera.response.empty()) {
    dark_counts_ = Image<float>(format.rows, format.cols, background_counts_);
    gain_ = Image<float>(format.rows, format.cols, 1.0F);
    for (std::size_t i = 0; i < gain_.size(); ++i) {
      const float dark = camera.dark_adu.empty() ? 0.0F : camera.dark_adu[i];
      const float response = camera.response.empty() ? 1.0F : camera.response[i];
      const bool good = std::isfinite(dark) && response > 0.0F && std::isfinite(response) &&
                        std::isfinite(1.0F / response);
      if (!camera.dark_adu.empty() && good) dark_counts_[i] = counts(static_cast<double>(dark));
      gain_[i] = good ? 1.0F / response : 0.0F;
    }
  }

  const double reach_px = kReach * camera.pixels_per_lambda_w;
  const int reach_steps = static_cast<int>(std::ceil(reach_px * kStepsPerPx)) + 1;
  table_.resize((2 * static_cast<std::size_t>(reach_steps) + 1) * kProjectionLanes);
  for (int step = -reach_steps; step <= reach_steps; ++step) {
    const double x = step / (kStepsPerPx * camera.pixels_per_lambda_w * kModeWidth);
    for (int order = 0; order <= kHighestOrder; ++order) {
      table_[static_cast<std::size_t>(step + reach_steps) * kProjectionLanes +
             static_cast<std::size_t>(order)] = static_cast<float>(hermite_function(order, x));
    }
    table_[static_cast<std::size_t>(step + reach_steps) * kProjectionLanes + kProjectionOnes] =
        1.0F;
  }
  for (std::size_t k = 0; k < spots_.size(); ++k) {
    const SpotWindow& window = camera.windows[k];
    if (window.w < 1 || window.h < 1) continue;
    if (window.x0 < 0 || window.y0 < 0 || window.x0 + window.w > format.cols ||
        window.y0 + window.h > format.rows) {
      throw Failure("a lenslet's window does not lie within the frame; calibrate anew");
    }
    const auto clip = [&](int start, int length, float reference, std::int32_t& n,
                          std::int32_t& place) {
      const auto centre = static_cast<double>(reference);
      const int first = std::max(start, static_cast<int>(std::ceil(centre - reach_px - 1e-6)));
      const int last =
          std::min(start + length - 1, static_cast<int>(std::floor(centre + reach_px + 1e-6)));
      n = std::max(0, last - first + 1);
      const auto step = static_cast<int>(std::lround((first - centre) * kStepsPerPx));
      place = (step + reach_steps) * kProjectionLanes;
      return first;
    };
    ProjectedWindow& spot = spots_[k];
    const int x0 = clip(window.x0, window.w, window.reference_x, spot.w, spot.along_x);
    const int y0 = clip(window.y0, window.h, window.reference_y, spot.h, spot.along_y);
    spot.first = y0 * format.cols + x0;
    if (spot.w == 0 || spot.h == 0) spot = {};
    const double read_noise = noise_known_ ? camera.read_noise_e : 0.0;
    spot.read_noise = static_cast<float>(read_noise * std::sqrt(1.0 * spot.w * spot.h));
  }
}

ProjectedFrame SpotFeatures::projected(FrameView frame) const noexcept {
  return {.pixels = frame.pixels,
          .pixel_type = pixel_type_,
          .cols = frame.cols,
          .size = std::ptrdiff_t{frame.rows} * frame.cols,
          .table = table_.data(),
          .table_step = std::ptrdiff_t{kStepsPerPx} * kProjectionLanes,
          .offset = background_counts_,
          .offsets = dark_counts_.empty() ? nullptr : dark_counts_.data(),
          .gains = gain_.empty() ? nullptr : gain_.data(),
          .e_per_count = e_per_count_,
          .row_sign = row_sign_};
}

void SpotFeatures::add_noise(const ProjectedWindow& spot, float flux, float flux_adu,
                             float mean_flux_adu, float* features) const noexcept {
  features += kSpotModes;
  const float inverse = 1.0F / flux;
  const float mean = std::max(mean_flux_adu * e_per_adu_, 1e-6F);
  const float floor = spot.read_noise + static_cast<float>(kDark) * mean;
  features[0] = (std::max(flux_adu, 0.0F) * e_per_adu_ + floor) / mean;
  features[1] = noise_known_ ? std::sqrt(inverse) : 0.0F;
  features[2] = spot.read_noise * inverse;
  features[3] = 1.0F;
}

void SpotFeatures::measure_many(FrameView frame, const std::int32_t* lenslets, int n,
                                const float* flux_adu, float mean_flux_adu,
                                float* features) const noexcept {
  std::array<float, kMaxAtOnce> fluxes;
  std::array<float, kMaxAtOnce> brightness;
  assert(n <= kMaxAtOnce);
  brightness.fill(1.0F);
  project_windows(projected(frame), spots_.data(), lenslets, n, kSpotFeatures, features,
                  fluxes.data());
  for (int i = 0; i < n; ++i) {
    const auto u = static_cast<std::size_t>(i);
    const auto k = static_cast<std::size_t>(lenslets[i]);
    float* const of_spot = features + u * kSpotFeatures;
    add_noise(spots_[k], fluxes[u], flux_adu[k], mean_flux_adu, of_spot);
    brightness[u] = of_spot[kSpotModes];
  }
  take_logarithms((n + kProjectionLanes - 1) / kProjectionLanes * kProjectionLanes,
                  brightness.data());
  for (std::size_t i = 0; i < static_cast<std::size_t>(n); ++i)
    features[i * kSpotFeatures + kSpotModes] = brightness[i];
}

void SpotFeatures::measure(FrameView frame, std::size_t k, float flux_adu, float mean_flux_adu,
                           float* features) const noexcept {
  std::array<float, kSpotFeatures> measured;
  const float flux = project_window(projected(frame), spots_[k], measured.data());
  add_noise(spots_[k], flux, flux_adu, mean_flux_adu, measured.data());
  for (std::size_t i = 0; i < kSpotFeatures; ++i)
    features[i] = measured[static_cast<std::size_t>(kMeasuredPlaces[i])];
  features[kSpotModes] = std::log(features[kSpotModes]);
}

}  // namespace curlew
