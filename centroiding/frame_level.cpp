#include "centroiding/frame_level.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <span>

#include "core/as_size.h"
#include "core/median.h"
#include "core/size_check.h"
#include "core/team.h"
#include "core/to_int.h"

namespace curlew {
namespace {

constexpr double kWide = 0.18;               // pitches, above the threshold and within the window
constexpr std::size_t kMaxResiduals = 2048;  // The median of so many scatters by 2 %.

/// Returns the pixel at (x, y), or a good one within a reach of it. Where there is none, it says
/// that the level is the calibration's.
LevelPixel good_pixel_near(const CentroidPlan& plan, int x, int y, int reach) noexcept {
  if (x >= 0 && y >= 0 && x < plan.frame_cols && y < plan.frame_rows && !plan.gain.empty()) {
    const int i = y * plan.frame_cols + x;
    const float gain = plan.gain[as_size(i)];
    if (gain > 0.0F)
      return {.index = i, .gain = gain, .offset = plan.offset[as_size(i)] - plan.threshold};
  }
  for (int distance = 0; distance <= reach; ++distance) {
    for (int dy = -distance; dy <= distance; ++dy) {
      for (int dx = -distance; dx <= distance; ++dx) {
        if (std::max(std::abs(dx), std::abs(dy)) != distance) continue;
        const int column = std::clamp(x + dx, 0, plan.frame_cols - 1);
        const int row = std::clamp(y + dy, 0, plan.frame_rows - 1);
        const int i = row * plan.frame_cols + column;
        if (plan.gain.empty())
          return {.index = i, .gain = 1.0F, .offset = plan.uniform_offset - plan.threshold};
        if (plan.gain[as_size(i)] > 0.0F)
          return {.index = i,
                  .gain = plan.gain[as_size(i)],
                  .offset = plan.offset[as_size(i)] - plan.threshold};
      }
    }
  }
  return {};
}

float read_noise_counts(const Sensor& sensor, const CentroidPlan& centroid) {
  const double noise_adu = sensor.detector.read_noise_e / sensor.detector.e_per_adu;
  return std::isfinite(noise_adu) ? static_cast<float>(noise_adu) / centroid.adu_per_count : 0.0F;
}

float median_of_three(float a, float b, float c) noexcept {
  return std::max(std::min(a, b), std::min(std::max(a, b), c));
}

/// Returns the mean of the middle two.
float median_of_four(float a, float b, float c, float d) noexcept {
  const float low = std::min(std::min(a, b), std::min(c, d));
  const float high = std::max(std::max(a, b), std::max(c, d));
  return 0.5F * (((a + b) + (c + d)) - low - high);
}

float median_of_five(float a, float b, float c, float d, float e) noexcept {
  const float f = std::max(std::min(a, b), std::min(c, d));
  const float g = std::min(std::max(a, b), std::max(c, d));
  return median_of_three(e, f, g);
}

/// The median of a block; of nine pixels the median of the medians of three.
float block_median(const float* v, int n) noexcept {
  if (n == 1) return v[0];
  if (n == 4) return median_of_four(v[0], v[1], v[2], v[3]);
  return median_of_three(median_of_three(v[0], v[1], v[2]), median_of_three(v[3], v[4], v[5]),
                         median_of_three(v[6], v[7], v[8]));
}

/// Measures rows [first, last) of the blocks.
template <typename Count>
void measure_blocks(const LevelPlan& plan, const LevelPixel* pixel, const Count* counts, int first,
                    int last, FrameLevels& levels) noexcept {
  const int n = plan.block_pixels();
  const std::size_t cols = as_size(levels.corner.cols());
  const std::size_t begin = as_size(first) * cols;
  const std::size_t end = as_size(last) * cols;
  pixel += begin * as_size(n);
  float* value = levels.values.data() + begin * as_size(n);
  for (std::size_t k = begin; k < end; ++k) {
    for (int i = 0; i < n; ++i)
      value[i] = pixel[i].gain * static_cast<float>(counts[pixel[i].index]) - pixel[i].offset;
    levels.corner[k] = block_median(value, n);
    pixel += n;
    value += n;
  }
}

/// Smooths rows [first, end) along columns of `from`, by a median that is symmetrical about each
/// place.
void smooth_down(const Image<float>& from, int first, int end, Image<float>& to) noexcept {
  const int last = from.rows() - 1;
  for (int r = first; r < end; ++r) {
    const int reach = std::min({2, r, last - r});
    const float* a = &from(r - reach, 0);
    const float* b = &from(r - reach / 2, 0);
    const float* c = &from(r, 0);
    const float* d = &from(r + reach / 2, 0);
    const float* e = &from(r + reach, 0);
    float* out = &to(r, 0);
    // Each loop does one thing, so that the compiler makes it one on vectors.
    if (reach == 2) {
      for (int k = 0; k < from.cols(); ++k) out[k] = median_of_five(a[k], b[k], c[k], d[k], e[k]);
    } else {
      for (int k = 0; k < from.cols(); ++k) out[k] = median_of_three(a[k], c[k], e[k]);
    }
  }
}

void smooth_across(const Image<float>& from, int first, int end, Image<float>& to) noexcept {
  const int last = from.cols() - 1;
  for (int r = first; r < end; ++r) {
    const float* row = &from(r, 0);
    float* out = &to(r, 0);
    for (int c = 2; c <= last - 2; ++c)
      out[c] = median_of_five(row[c - 2], row[c - 1], row[c], row[c + 1], row[c + 2]);
    for (const int c : {0, 1, last - 1, last}) {
      const int reach = std::min(c, last - c);
      if (reach >= 0 && reach < 2) out[c] = median_of_three(row[c - reach], row[c], row[c + reach]);
    }
  }
}

/// Returns the level at a corner inside the array, from the four lenslets round it.
float level_at_corner(const Image<float>& level, int r, int c) noexcept {
  return 0.25F * ((level(r - 1, c - 1) + level(r - 1, c)) + (level(r, c - 1) + level(r, c)));
}

/// Collects how far the pixels of blocks between lenslet rows [first, last) and those before lie
/// from the level, of some where there are many.
void collect_residuals(const LevelPlan& plan, int first, int last, FrameLevels& levels) noexcept {
  const std::size_t n = as_size(plan.block_pixels());
  const std::size_t inner = as_size(plan.rows() - 1) * as_size(plan.cols() - 1) * n;
  const std::size_t stride = inner / kMaxResiduals + 1;
  for (int r = std::max(first, 1); r < last; ++r) {
    for (int c = 1; c < plan.cols(); ++c) {
      const float* value = levels.values.data() + as_size(r * (plan.cols() + 1) + c) * n;
      for (; levels.next_residual < n; levels.next_residual += stride)
        levels.residuals[levels.n_residuals++] =
            std::abs(value[levels.next_residual] - level_at_corner(levels.level, r, c));
      levels.next_residual -= n;
    }
  }
}

/// The rms within three σ, σ from the median; a Gaussian keeps .9733 of its variance there.
float noise_of(std::span<float> residuals) noexcept {
  constexpr float kSigmaOfMedian = 1.4826F;
  constexpr float kKept = 0.9733F;
  constexpr float kCount = 0.5F;  // Where noise is far below a count, nearly all residuals are 0.
  if (residuals.empty()) return 0.0F;
  const float cut = 3.0F * kSigmaOfMedian * median_of_magnitudes(residuals) + kCount;
  double sum = 0.0;
  int n = 0;
  for (const float residual : residuals) {
    if (residual > cut) continue;
    sum += static_cast<double>(residual) * static_cast<double>(residual);
    ++n;
  }
  return n > 0 ? std::sqrt(static_cast<float>(sum / n) / kKept) : 0.0F;
}

/// By how much the highest or lowest level may differ from one frame to the next.
float margin_of(const FrameLevels& levels, float level) noexcept {
  constexpr float kCount = 0.5F;
  constexpr float kOfLevel = 0.1F;
  return levels.noise + kCount + kOfLevel * std::abs(level);
}

}  // namespace

LevelPlan::LevelPlan(const Sensor& sensor, const CentroidPlan& centroid,
                     const CentroidOptions& options)
    : frame_rows_(centroid.frame_rows),
      frame_cols_(centroid.frame_cols),
      rows_(sensor.valid.rows()),
      cols_(sensor.valid.cols()),
      grid_(sensor.grid),
      block_side_px_(std::max(1, static_cast<int>(std::lround(sensor.grid.pitch_px() / 5.0)))),
      block_pixels_(std::min(block_side_px_, 3) * std::min(block_side_px_, 3)),
      pixels_(as_size(rows_ + 1) * as_size(cols_ + 1) * as_size(block_pixels_)),
      corners_are_lit_(sensor.spot_sigma_px > kWide * sensor.grid.pitch_px() &&
                       read_noise_counts(sensor, centroid) > 0.0F),
      plain_(options.method == CentroidMethod::kPlain),
      gain_known_(sensor.detector.e_per_adu > 0.0),
      fixed_threshold_(static_cast<float>(options.threshold_adu) / centroid.adu_per_count),
      read_noise_(read_noise_counts(sensor, centroid)),
      threshold_noise_(static_cast<float>(options.threshold_noise)) {
  place(centroid, {}, pixels_);
}

void LevelPlan::place(const CentroidPlan& centroid, const LowOrders& model,
                      std::vector<LevelPixel>& pixels, Team* team) const noexcept {
  const int reach = std::max(1, static_cast<int>(0.5 * grid_.pitch_px()));
  const int across = std::min(block_side_px_, 3);  // pixels looked at along an axis
  const double step = across > 1 ? (block_side_px_ - 1.0) / (across - 1) : 0.0;
  std::array<int, 3> offsets{};
  for (int i = 0; i < across; ++i) offsets[as_size(i)] = static_cast<int>(std::lround(step * i));
  // What is extrapolated into the dark may be anything.
  const float limit = 4.0F * static_cast<float>(grid_.pitch_px());
  const auto place_row = [&](int r) {
    LevelPixel* pixel = pixels.data() + as_size(r) * as_size(cols_ + 1) * as_size(block_pixels_);
    const LowOrders::Row displacements =
        model.along(model_coordinate(static_cast<float>(r) - 0.5F, rows_));
    for (int c = 0; c <= cols_; ++c) {
      const auto [dx, dy] = displacements.at(model_coordinate(static_cast<float>(c) - 0.5F, cols_));
      const auto [x, y] = grid_.pixel_from_lenslet(c - 0.5, r - 0.5);
      const auto first = [&](double corner, float moved) {
        return round_to_int(corner + static_cast<double>(std::clamp(moved, -limit, limit)) -
                            0.5 * (block_side_px_ - 1));
      };
      const int left = first(x, dx);
      const int top = first(y, dy);
      for (int row = 0; row < across; ++row)
        for (int column = 0; column < across; ++column)
          *pixel++ = good_pixel_near(centroid, left + offsets[as_size(column)],
                                     top + offsets[as_size(row)], reach);
    }
  };
  share_rows(team, 0, rows_ + 1, [&](int, int first, int last) {
    for (int r = first; r < last; ++r) place_row(r);
  });
}

FrameLevels::FrameLevels(const LevelPlan& plan)
    : level(plan.rows(), plan.cols()),
      corner(plan.rows() + 1, plan.cols() + 1),
      scratch(plan.rows(), plan.cols()),
      values(plan.pixels().size()),
      residuals(std::min(values.size(), kMaxResiduals) + 1),
      raw(plan.rows(), plan.cols()) {}

void begin_levels(FrameLevels& levels) noexcept {
  levels.corner_rows = levels.raw_rows = levels.rows = 0;
  levels.n_residuals = levels.next_residual = 0;
  levels.highest = std::numeric_limits<float>::lowest();
  levels.lowest = std::numeric_limits<float>::max();
}

void measure_level_rows(const LevelPlan& plan, const std::vector<LevelPixel>& pixels,
                        FrameView frame, int corner_rows, FrameLevels& levels,
                        Team* team) noexcept {
  check_size("measure_levels", "a frame", {frame.rows, frame.cols},
             {plan.frame_rows(), plan.frame_cols()});
  check_size("measure_levels", "levels", size_of(levels.level), size_of(plan));
  if (corner_rows <= levels.corner_rows) return;
  share_rows(team, levels.corner_rows, corner_rows, [&](int, int first, int last) {
    if (frame.pixel_type == PixelType::kU16)
      measure_blocks(plan, pixels.data(), frame.data<std::uint16_t>(), first, last, levels);
    else
      measure_blocks(plan, pixels.data(), frame.data<std::uint8_t>(), first, last, levels);
  });
  levels.corner_rows = corner_rows;
  for (; levels.raw_rows + 1 < corner_rows; ++levels.raw_rows) {
    const int r = levels.raw_rows;
    const float* upper = &levels.corner(r, 0);
    const float* lower = &levels.corner(r + 1, 0);
    for (int c = 0; c < plan.cols(); ++c)
      levels.raw(r, c) = median_of_four(upper[c], upper[c + 1], lower[c], lower[c + 1]);
  }
  constexpr int kReach = 2;
  const int end = levels.raw_rows == plan.rows() ? plan.rows() : levels.raw_rows - kReach;
  if (end <= levels.rows) return;
  smooth_down(levels.raw, levels.rows, end, levels.scratch);
  smooth_across(levels.scratch, levels.rows, end, levels.level);
  const float* first = &levels.level(levels.rows, 0);
  const float* last = first + as_size(end - levels.rows) * as_size(plan.cols());
  levels.highest = std::max(levels.highest, *std::max_element(first, last));
  levels.lowest = std::min(levels.lowest, *std::min_element(first, last));
  collect_residuals(plan, levels.rows, end, levels);
  levels.rows = end;
}

void finish_levels(const LevelPlan& plan, FrameLevels& levels) noexcept {
  levels.noise = noise_of({levels.residuals.data(), levels.n_residuals});
  go_by(plan, {.noise = levels.noise, .bound = levels.highest, .floor = levels.lowest}, levels);
}

LevelForecast forecast_after(const FrameLevels& levels) noexcept {
  return {.noise = levels.noise,
          .bound = levels.highest + margin_of(levels, levels.highest),
          .floor = levels.lowest - margin_of(levels, levels.lowest)};
}

bool came_true(const LevelForecast& forecast, const FrameLevels& levels) noexcept {
  constexpr float kNoiseHeld = 0.125F;
  const auto is_near = [&](float distance, float level) {
    return distance >= 0.0F && distance <= 2.0F * margin_of(levels, level);
  };
  return forecast.noise >= 0.0F &&
         std::abs(levels.noise - forecast.noise) <= kNoiseHeld * forecast.noise &&
         is_near(forecast.bound - levels.highest, levels.highest) &&
         is_near(levels.lowest - forecast.floor, levels.lowest);
}

void go_by(const LevelPlan& plan, const LevelForecast& forecast, FrameLevels& levels) noexcept {
  levels.threshold = plan.threshold(forecast.noise);
  levels.pixel_variance = plan.pixel_variance(forecast.noise);
  levels.bound = forecast.bound;
  levels.floor = forecast.floor;
}

void measure_levels(const LevelPlan& plan, const std::vector<LevelPixel>& pixels, FrameView frame,
                    FrameLevels& levels, Team* team) noexcept {
  begin_levels(levels);
  measure_level_rows(plan, pixels, frame, plan.rows() + 1, levels, team);
  finish_levels(plan, levels);
}

}  // namespace curlew
