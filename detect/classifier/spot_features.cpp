#include "detect/classifier/spot_features.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <cstdint>
#include <string>

#include "core/error.h"
#include "core/to_int.h"

namespace curlew {
namespace {

// The Hermite functions have this width, in units of λ/w.
constexpr double kModeWidth = 0.6;
// References are rounded to multiples of 1/kStepsPerPx of a pixel.
constexpr int kStepsPerPx = 16;
// Spots much fainter than this part of the mean flux all look equally dark.
constexpr double kDark = 0.01;

/// Returns the Hermite function of this order. They are orthogonal and all have the same norm; the
/// function of order 0 is 1 at x = 0.
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

void check_camera(const SpotCamera& camera, const FrameFormat& format) {
  if (!(camera.pixels_per_lambda_w > 0.2 && camera.pixels_per_lambda_w < 200.0)) {
    throw Failure("λ/w covers " + std::to_string(camera.pixels_per_lambda_w) +
                  " pixels of the detector, which no classifier can use; check the optics");
  }
  if (format.cols < kProjectionLanes) {
    throw Failure("a frame of " + std::to_string(format.cols) +
                  " columns is too narrow for the classifier, which reads " +
                  std::to_string(kProjectionLanes) + " at once; take another detection method");
  }
}

float counts(double adu, const FrameFormat& format) {
  return static_cast<float>((adu - format.zero_adu) / format.scale_adu);
}

/// Writes the dark and the gain of every pixel. A bad pixel keeps the dark it has and gets gain 0.
void calibrate_pixels(const SpotCamera& camera, const FrameFormat& format,
                      Image<float>& dark_counts, Image<float>& gain) {
  for (std::size_t i = 0; i < gain.size(); ++i) {
    const float dark = camera.dark_adu.empty() ? 0.0F : camera.dark_adu[i];
    const float response = camera.response.empty() ? 1.0F : camera.response[i];
    const bool good = std::isfinite(dark) && response > 0.0F && std::isfinite(response) &&
                      std::isfinite(1.0F / response);
    if (!camera.dark_adu.empty() && good)
      dark_counts[i] = counts(static_cast<double>(dark), format);
    gain[i] = good ? 1.0F / response : 0.0F;
  }
}

/// Tabulates the Hermite functions. The steps run from −reach.steps on. A row of the table holds
/// all orders at one step, and then the lane that is 1.
AlignedVector<float> hermite_table(double pixels_per_lambda_w, const ModeReach& reach) {
  AlignedVector<float> table((2 * static_cast<std::size_t>(reach.steps) + 1) * kProjectionLanes);
  for (int step = -reach.steps; step <= reach.steps; ++step) {
    const double x = step / (kStepsPerPx * pixels_per_lambda_w * kModeWidth);
    float* const row =
        table.data() + static_cast<std::size_t>(step + reach.steps) * kProjectionLanes;
    for (int order = 0; order <= kHighestOrder; ++order)
      row[order] = static_cast<float>(hermite_function(order, x));
    row[kProjectionOnes] = 1.0F;
  }
  return table;
}

/// Holds the pixels of a window within the reach along one axis.
struct ReachedPixels {
  int first;
  std::int32_t n;
  std::int32_t along;  ///< The first pixel's row of the table begins here.
};

ReachedPixels clip(int start, int length, float reference, const ModeReach& reach) {
  const auto centre = static_cast<double>(reference);
  const int first = std::max(start, ceil_to_int(centre - reach.px - 1e-6));
  const int last = std::min(start + length - 1, floor_to_int(centre + reach.px + 1e-6));
  const auto step = round_to_int((first - centre) * kStepsPerPx);
  return {.first = first,
          .n = std::max(0, last - first + 1),
          .along = (step + reach.steps) * kProjectionLanes};
}

void check_window(const SpotWindow& window, const FrameFormat& format) {
  if (window.x0 < 0 || window.y0 < 0 || window.x0 + window.w > format.cols ||
      window.y0 + window.h > format.rows) {
    throw Failure("a lenslet's window does not lie within the frame; calibrate anew");
  }
}

/// Returns the part of a window within the reach. Nothing of it must lie beyond the frame.
ProjectedWindow clip_window(const SpotWindow& window, const ModeReach& reach, int frame_cols,
                            float read_noise_e) {
  const ReachedPixels x = clip(window.x0, window.w, window.reference_x, reach);
  const ReachedPixels y = clip(window.y0, window.h, window.reference_y, reach);
  ProjectedWindow spot;
  if (x.n > 0 && y.n > 0) {
    spot = {.first = y.first * frame_cols + x.first,
            .w = x.n,
            .h = y.n,
            .along_x = x.along,
            .along_y = y.along};
  }
  spot.read_noise = read_noise_e * std::sqrt(static_cast<float>(spot.w * spot.h));
  return spot;
}

/// Moves a window that begins at `start` and keeps what is left of it within [0, size).
void move_within(int move, int size, int& start, int& length) {
  const int first = std::clamp(start + move, 0, size);
  length = std::clamp(start + move + length, first, size) - first;
  start = first;
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

ModeReach::ModeReach(double reach_px)
    // A sampling that makes no sense is refused afterwards.
    : px(reach_px), steps(px < 1e6 ? static_cast<int>(std::ceil(px * kStepsPerPx)) + 1 : 1) {}

constexpr std::array<int, kSpotFeatures> kMeasuredPlaces = [] {
  std::array<int, kSpotFeatures> places{};
  int i = 0;
  for (int order = 0; order < kProjectionOrders; ++order) {
    for (int m = 0; m <= order; ++m, ++i) {
      // Before mode (m, n) there are n rows of modes. The first has kProjectionOrders, and each
      // next row has one fewer.
      const int n = order - m;
      places[static_cast<std::size_t>(i)] = n * kProjectionOrders - n * (n - 1) / 2 + m;
    }
  }
  for (; i < kSpotFeatures; ++i) places[static_cast<std::size_t>(i)] = i;
  return places;
}();

SpotFeatures::SpotFeatures(const SpotCamera& camera, const FrameFormat& format)
    : windows_(camera.windows),
      spots_(camera.windows.rows(), camera.windows.cols()),
      reach_(kModeReach * camera.pixels_per_lambda_w),
      frame_rows_(format.rows),
      frame_cols_(format.cols),
      read_noise_e_(camera.e_per_adu > 0.0 ? static_cast<float>(camera.read_noise_e) : 0.0F),
      pixel_type_(format.pixel_type),
      noise_known_(camera.e_per_adu > 0.0),
      row_sign_(camera.rows_run_up ? -1.0F : 1.0F) {
  check_camera(camera, format);
  const double e_per_adu = noise_known_ ? camera.e_per_adu : 1.0;
  e_per_adu_ = static_cast<float>(e_per_adu);
  e_per_count_ = static_cast<float>(e_per_adu * format.scale_adu);
  background_counts_ = counts(camera.background_adu, format);
  if (!camera.dark_adu.empty() || !camera.response.empty()) {
    dark_counts_ = Image<float>(format.rows, format.cols, background_counts_);
    gain_ = Image<float>(format.rows, format.cols, 1.0F);
    calibrate_pixels(camera, format, dark_counts_, gain_);
  }
  table_ = hermite_table(camera.pixels_per_lambda_w, reach_);
  for (std::size_t k = 0; k < spots_.size(); ++k) {
    const SpotWindow& window = camera.windows[k];
    if (window.w < 1 || window.h < 1) continue;
    check_window(window, format);
    spots_[k] = clip_window(window, reach_, format.cols, read_noise_e_);
  }
}

ProjectedWindow SpotFeatures::placed(const FrameShift& shift, std::size_t k) const noexcept {
  ProjectedWindow spot = spots_[k];
  const auto at = [k](const Image<float>* map) { return map != nullptr ? (*map)[k] : 0.0F; };
  const float dx = at(shift.spots_x_px);
  const float dy = at(shift.spots_y_px);
  const float noise_e =
      noise_known_ ? std::max(shift.noise_counts * e_per_count_, read_noise_e_) : 0.0F;
  if (dx != 0.0F || dy != 0.0F) {
    SpotWindow window = windows_[k];
    move_within(static_cast<int>(at(shift.windows_x_px)), frame_cols_, window.x0, window.w);
    move_within(static_cast<int>(at(shift.windows_y_px)), frame_rows_, window.y0, window.h);
    window.reference_x += dx;
    window.reference_y += dy;
    spot = clip_window(window, reach_, frame_cols_, noise_e);
  } else if (noise_e > read_noise_e_) {
    spot.read_noise = noise_e * std::sqrt(static_cast<float>(spot.w * spot.h));
  }
  spot.level = at(shift.level_counts);
  return spot;
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

void SpotFeatures::measure_many(FrameView frame, const FrameShift& shift,
                                const std::int32_t* lenslets, int n, const float* flux_adu,
                                float mean_flux_adu, float* features) const noexcept {
  std::array<ProjectedWindow, kMaxAtOnce> windows;
  std::array<float, kMaxAtOnce> fluxes;
  std::array<float, kMaxAtOnce> brightness;
  assert(n <= kMaxAtOnce);
  brightness.fill(1.0F);
  for (std::size_t i = 0; i < static_cast<std::size_t>(n); ++i)
    windows[i] = placed(shift, static_cast<std::size_t>(lenslets[i]));
  project_windows(projected(frame), windows.data(), n, kSpotFeatures, features, fluxes.data());
  for (std::size_t i = 0; i < static_cast<std::size_t>(n); ++i) {
    float* const of_spot = features + i * kSpotFeatures;
    add_noise(windows[i], fluxes[i], flux_adu[lenslets[i]], mean_flux_adu, of_spot);
    brightness[i] = of_spot[kSpotModes];
  }
  take_logarithms((n + kProjectionLanes - 1) / kProjectionLanes * kProjectionLanes,
                  brightness.data());
  for (std::size_t i = 0; i < static_cast<std::size_t>(n); ++i)
    features[i * kSpotFeatures + kSpotModes] = brightness[i];
}

void SpotFeatures::measure(FrameView frame, const FrameShift& shift, std::size_t k, float flux_adu,
                           float mean_flux_adu, float* features) const noexcept {
  std::array<float, kSpotFeatures> measured;
  const ProjectedWindow spot = placed(shift, k);
  const float flux = project_window(projected(frame), spot, measured.data());
  add_noise(spot, flux, flux_adu, mean_flux_adu, measured.data());
  for (std::size_t i = 0; i < kSpotFeatures; ++i)
    features[i] = measured[static_cast<std::size_t>(kMeasuredPlaces[i])];
  features[kSpotModes] = std::log(features[kSpotModes]);
}

}  // namespace curlew
