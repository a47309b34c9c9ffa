// What of a frame WindowFollower measures before it is whole.
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "centroiding/window_follower.h"
#include "core/as_size.h"

namespace curlew {
namespace {

/// Copies what was measured of `n` lenslets from `first` on.
void copy_lenslets(const Centroids& from, std::size_t first, std::size_t n,
                   Centroids& to) noexcept {
  constexpr std::array kMeasured{
      &Centroids::x_px,           &Centroids::y_px,           &Centroids::flux_adu,
      &Centroids::xx_px2,         &Centroids::yy_px2,         &Centroids::xy_px2,
      &Centroids::variance_x_px2, &Centroids::variance_y_px2, &Centroids::covariance_xy_px2};
  for (const auto map : kMeasured)
    std::copy_n((from.*map).data() + first, n, (to.*map).data() + first);
  std::copy_n(from.state.data() + first, n, to.state.data() + first);
}

/// Returns by how many pixels a window should follow a spot that lies so far off its middle. A spot
/// about half a pixel off stays, or noise would take its window to and fro.
int steps_to(float off_px) noexcept {
  constexpr float kNear_px = 0.75F;
  return std::abs(off_px) <= kNear_px ? 0 : static_cast<int>(std::lround(off_px));
}

bool holds_candidate(const CentroidPlan::Spot& spot, const SharpPixels& sharp) noexcept {
  const auto is_in = [&](const SharpPixel& at) {
    return at.x >= spot.x0 && at.x < spot.x0 + spot.w && at.y >= spot.y0 && at.y < spot.y0 + spot.h;
  };
  return std::any_of(sharp.candidates.begin(), sharp.candidates.end(), is_in) ||
         std::any_of(sharp.clump_candidates.begin(), sharp.clump_candidates.end(), is_in);
}

}  // namespace

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
  if (!measures_ahead_) return false;
  next_forecast_ = forecast_after(levels);
  if (!came_true(forecast_, levels)) return false;
  go_by(level_plan, forecast_, levels);
  return true;
}

/// Returns whether lenslet k's spot lies off its window's middle, as it was measured at first.
bool WindowFollower::is_off_centre(const Centroids& looked, std::size_t k) const noexcept {
  const float x = looked.x_px[k] - middle_x_px_[k] - moved_x_px_[k];
  const float y = looked.y_px[k] - middle_y_px_[k] - moved_y_px_[k];
  return x * x + y * y > reach_px_ * reach_px_;
}

/// Centres lenslet k's window on its spot, for this frame only.
void WindowFollower::centre_window(const CentroidPlan& plan, const Centroids& looked, std::size_t k,
                                   Centroids& centroids) noexcept {
  const float x = looked.x_px[k] - middle_x_px_[k] - moved_x_px_[k];
  const float y = looked.y_px[k] - middle_y_px_[k] - moved_y_px_[k];
  place_window(plan, k, static_cast<int>(std::lround(moved_x_px_[k])) + steps_to(x),
               static_cast<int>(std::lround(moved_y_px_[k])) + steps_to(y), centred_);
  centroids.moved_x_px[k] = static_cast<float>(centred_[k].x0 - plan.spots[k].x0);
  centroids.moved_y_px[k] = static_cast<float>(centred_[k].y0 - plan.spots[k].y0);
  off_centre_[k] = 1;
  any_centred_ = true;
}

/// Puts it back to where the other windows are.
void WindowFollower::return_window(std::size_t k, Centroids& centroids) noexcept {
  centred_[k] = windows_[k];
  centroids.moved_x_px[k] = moved_x_px_[k];
  centroids.moved_y_px[k] = moved_y_px_[k];
  off_centre_[k] = 0;
}

/// Puts back all that the frame before has centred.
void WindowFollower::return_windows() noexcept {
  if (!std::exchange(any_centred_, false)) return;
  const std::size_t cols = as_size(windows_.cols());
  for (std::size_t first = 0; first < off_centre_.size(); first += cols) {
    int any = 0;
    for (std::size_t k = first; k < first + cols; ++k) any |= off_centre_[k];
    if (any == 0) continue;
    for (std::size_t k = first; k < first + cols; ++k)
      if (off_centre_[k] != 0) centred_[k] = windows_[k];
    std::fill_n(off_centre_.data() + first, cols, std::uint8_t{0});
  }
}

void WindowFollower::give_up() noexcept {
  return_windows();
  ahead_ = {};
}

/// Measures spots that lie off their windows' middle in windows that are centred on them, before
/// it is known which of them are their lenslets'. It does so for rows of lenslets whose windows lie
/// in the frame's first `ready` rows. Windows that would hold sharp pixels are left for later.
void WindowFollower::centre_ahead(const CentroidPlan& plan, FrameView frame, int ready,
                                  const FrameLevels& levels, const SharpPixels& sharp,
                                  Centroids& centroids) noexcept {
  const std::size_t cols = as_size(windows_.cols());
  const int first_row = ahead_.centred;
  bool any = false;
  for (; ahead_.centred < ahead_.rows; ++ahead_.centred) {
    const std::size_t first = as_size(ahead_.centred) * cols;
    int bottom = 0;
    for (std::size_t k = first; k < first + cols; ++k) {
      if (centroids.state[k] != LensletState::kValid || !is_off_centre(centroids, k)) continue;
      centre_window(plan, centroids, k, centroids);
      if (holds_candidate(centred_[k], sharp))
        return_window(k, centroids);
      else
        bottom = std::max(bottom, centred_[k].y0 + centred_[k].h);
    }
    if (bottom > ready) {
      for (std::size_t k = first; k < first + cols; ++k)
        if (off_centre_[k] != 0) return_window(k, centroids);
      break;
    }
    any = any || bottom > 0;
  }
  const std::size_t begin = as_size(first_row) * cols;
  copy_lenslets(centroids, begin, as_size(ahead_.centred) * cols - begin, first_look_);
  if (any)
    find_centroids_rows(plan, frame, first_row, ahead_.centred, centroids,
                        {&levels, nullptr, &centred_, &off_centre_});
}

int WindowFollower::measure_ahead(const CentroidPlan& plan, const LevelPlan& level_plan,
                                  const SharpPixelPlan& sharp_plan, FrameView frame, int ready,
                                  FrameLevels& levels, SharpPixels& sharp,
                                  Centroids& centroids) noexcept {
  if (!measures_ahead_ || forecast_.noise < 0.0F) return 0;
  if (!ahead_.begun) {
    return_windows();
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
  if (last > ahead_.rows)
    find_centroids_rows(plan, frame, ahead_.rows, last, centroids,
                        {&levels, &sharp, &windows_, nullptr, &strips_});
  ahead_.rows = last;
  centre_ahead(plan, frame, looked_at, levels, sharp, centroids);
  return ahead_.centred;
}

/// Measures the spots where the windows are: the rest of them if measure_ahead() has begun and the
/// forecast came true, and else all. Returns what was measured there; spots that have been centred
/// ahead have something else in `centroids`.
const Centroids& WindowFollower::measure_spots(const CentroidPlan& plan,
                                               const LevelPlan& level_plan,
                                               const SharpPixelPlan& sharp_plan, FrameView frame,
                                               FrameLevels& levels, SharpPixels& sharp,
                                               Centroids& centroids) noexcept {
  if (!ahead_.begun) {
    return_windows();
    begin_levels(levels);
  }
  measure_level_rows(level_plan, blocks_, frame, windows_.rows() + 1, levels, team_);
  finish_levels(level_plan, levels);
  if (!go_by_forecast(level_plan, levels)) give_up();
  if (!ahead_.begun) {
    begin_sharp_pixels(sharp);
    tell_windows(centroids);
  }
  find_sharp_pixels_rows(sharp_plan, plan, windows_, frame, frame.rows, levels, sharp, team_);
  find_centroids_rows(plan, frame, ahead_.rows, windows_.rows(), centroids,
                      {&levels, &sharp, &windows_, nullptr, &strips_, false, team_});
  const Ahead ahead = std::exchange(ahead_, {});
  std::fill(row_changed_.begin(), row_changed_.begin() + ahead.centred, std::uint8_t{0});
  std::fill(row_changed_.begin() + ahead.centred, row_changed_.end(), std::uint8_t{1});
  if (!ahead.begun) return centroids;
  const std::size_t first = as_size(ahead.centred) * as_size(windows_.cols());
  copy_lenslets(centroids, first, windows_.size() - first, first_look_);
  return first_look_;
}

/// Measures the spots that lie off their windows' middle in windows that are centred on them, and
/// takes back where that was done ahead of what is no spot of its lenslet. `looked` is what
/// measure_spots() returned.
void WindowFollower::centre_spots(const CentroidPlan& plan, const SharpPixelPlan& sharp_plan,
                                  FrameView frame, const FrameLevels& levels, SharpPixels& sharp,
                                  const Centroids& looked, Centroids& centroids) noexcept {
  const std::size_t cols = as_size(windows_.cols());
  const auto count = [&](LensletState state, int one) {
    if (state == LensletState::kValid) centroids.n_valid += one;
    if (state == LensletState::kSaturated) centroids.n_saturated += one;
  };
  const auto is_due = [&](std::size_t k) {
    return static_cast<int>(is_off_centre(looked, k)) & static_cast<int>(judge_.has_spot(k));
  };
  bool any_due = false;
  for (std::size_t row = 0; row < row_changed_.size(); ++row) {
    const std::size_t first = row * cols;
    int differs = 0;
    for (std::size_t k = first; k < first + cols; ++k)  // stores nothing, so that it is vectors
      differs |= is_due(k) ^ off_centre_[k];
    if (differs == 0) continue;
    row_changed_[row] = 1;
    for (std::size_t k = first; k < first + cols; ++k) {
      if (is_due(k) == off_centre_[k]) continue;
      if (off_centre_[k] == 0) {
        centre_window(plan, looked, k, centroids);
        due_[k] = 1;
        any_due = true;
      } else {
        count(centroids.state[k], -1);
        copy_lenslets(looked, k, 1, centroids);
        count(centroids.state[k], 1);
        return_window(k, centroids);
      }
    }
  }
  if (!any_due) return;
  assign_sharp_pixels(sharp_plan, plan, centred_, frame, levels, sharp);
  find_centroids(
      plan, frame, centroids,
      {.levels = &levels, .sharp = &sharp, .windows = &centred_, .only = &due_, .team = team_});
  due_.fill(0);
}

}  // namespace curlew
