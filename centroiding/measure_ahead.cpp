// What of a frame WindowFollower measures before it is whole.
#include <algorithm>
#include <utility>

#include "centroiding/window_follower.h"
#include "core/as_size.h"

namespace curlew {

/// Counts the rows of the frame that must have arrived before each row of blocks and of lenslets
/// can be measured. These are measured in their order, so that the numbers never fall.
void WindowFollower::count_rows_needed(const LevelPlan& level_plan) noexcept {
  const std::size_t of_row = as_size(level_plan.cols() + 1) * as_size(level_plan.block_pixels());
  int needed = 0;
  for (std::size_t i = 0; i < block_rows_needed_.size(); ++i) {
    std::int32_t last = 0;
    for (std::size_t j = i * of_row; j < (i + 1) * of_row; ++j)
      last = std::max(last, blocks_[j].index);
    needed = std::max(needed, last / level_plan.frame_cols() + 1);
    block_rows_needed_[i] = needed;
  }
  needed = 0;
  for (int r = 0; r < windows_.rows(); ++r) {
    for (int c = 0; c < windows_.cols(); ++c)
      needed = std::max(needed, windows_(r, c).y0 + windows_(r, c).h);
    rows_needed_[as_size(r)] = needed;
  }
}

/// Says how far the windows were moved.
void WindowFollower::tell_windows(Centroids& centroids) const noexcept {
  centroids.low_x_px = model_x_px_;
  centroids.low_y_px = model_y_px_;
  centroids.moved_x_px = moved_x_px_;
  centroids.moved_y_px = moved_y_px_;
}

/// Goes by the forecast where the levels, which have been measured, say that it came true. Returns
/// whether it did.
bool WindowFollower::go_by_forecast(const LevelPlan& level_plan, FrameLevels& levels) noexcept {
  next_forecast_ = forecast_after(levels);
  if (!came_true(forecast_, levels)) return false;
  go_by(level_plan, forecast_, levels);
  return true;
}

int WindowFollower::measure_ahead(const CentroidPlan& plan, const LevelPlan& level_plan,
                                  const SharpPixelPlan& sharp_plan, FrameView frame, int ready,
                                  FrameLevels& levels, SharpPixels& sharp,
                                  Centroids& centroids) noexcept {
  if (forecast_.noise < 0.0F) return 0;
  if (!ahead_.begun) {
    begin_levels(levels);
    begin_sharp_pixels(sharp);
    go_by(level_plan, forecast_, levels);
    tell_windows(centroids);
    ahead_.begun = true;
  }
  int blocks = levels.corner_rows;
  while (blocks <= windows_.rows() && block_rows_needed_[as_size(blocks)] <= ready) ++blocks;
  measure_level_rows(level_plan, blocks_, frame, blocks, levels);
  const int looked_at =
      find_sharp_pixels_rows(sharp_plan, plan, windows_, frame, ready, levels, sharp);
  int last = ahead_.rows;
  while (last < levels.rows && rows_needed_[as_size(last)] <= looked_at) ++last;
  if (last == ahead_.rows) return last;
  find_centroids_rows(plan, frame, ahead_.rows, last, centroids,
                      {&levels, &sharp, &windows_, nullptr, &strips_});
  ahead_.rows = last;
  return last;
}

/// Measures the spots where the windows are: the rest of them if measure_ahead() has begun and the
/// forecast came true, and else all. Returns whether what was measured ahead stands.
bool WindowFollower::measure_spots(const CentroidPlan& plan, const LevelPlan& level_plan,
                                   const SharpPixelPlan& sharp_plan, FrameView frame,
                                   FrameLevels& levels, SharpPixels& sharp,
                                   Centroids& centroids) noexcept {
  if (!ahead_.begun) begin_levels(levels);
  measure_level_rows(level_plan, blocks_, frame, windows_.rows() + 1, levels);
  finish_levels(level_plan, levels);
  if (!go_by_forecast(level_plan, levels)) ahead_ = {};
  if (!ahead_.begun) begin_sharp_pixels(sharp);
  find_sharp_pixels_rows(sharp_plan, plan, windows_, frame, frame.rows, levels, sharp);
  find_centroids_rows(plan, frame, ahead_.rows, windows_.rows(), centroids,
                      {&levels, &sharp, &windows_, nullptr, &strips_});
  std::fill(row_changed_.begin(), row_changed_.begin() + ahead_.rows, std::uint8_t{0});
  std::fill(row_changed_.begin() + ahead_.rows, row_changed_.end(), std::uint8_t{1});
  return std::exchange(ahead_, {}).begun;
}

}  // namespace curlew
