#include "centroiding/window_follower.h"

#include <algorithm>
#include <cmath>

#include "core/as_size.h"
#include "core/size_check.h"
#include "core/team.h"
#include "core/to_int.h"

namespace curlew {
namespace {

// All distances are in pitches.
constexpr float kFollowed = 0.15F;  // Windows stay while the spots' low orders are within this.
// Where spots light the corners between the windows, the level rises as they come nearer.
constexpr float kFollowedClosely = 0.05F;
constexpr float kCutOff = 0.2F;     // A window that the frame holds back by more loses light.
constexpr float kHome = 0.1F;       // Windows settle at home if the low orders are within this,
constexpr float kRounded = 0.025F;  // and else at low orders that are multiples of this.
constexpr float kStep = 0.3F;       // The windows are moved this far without a new search.
// Standard deviations of the noise, above which a dark window has hardly any pixel.
constexpr float kSurelyLight = 3.5F;

/// Returns how far a window of length `n` from `start` must be moved to lie in [0, length).
int back_into(int start, int n, int length) noexcept {
  return std::clamp(start, 0, length - n) - start;
}

bool leaves_dark_windows_empty(const CentroidPlan& plan, const FrameLevels& levels) noexcept {
  return plan.method == CentroidMethod::kThresholded &&
         levels.threshold >= kSurelyLight * levels.noise;
}

}  // namespace

WindowFollower::WindowFollower(const Sensor& sensor, const CentroidPlan& plan,
                               const LevelPlan& level_plan, const CentroidOptions& options)
    : acquisition_(sensor, plan),
      judge_(sensor, plan),
      foreign_light_(sensor, plan),
      pitch_px_(static_cast<float>(sensor.grid.pitch_px())),
      followed_px_(pitch_px_ * (level_plan.corners_are_lit() ? kFollowedClosely : kFollowed)),
      middle_blocks_(level_plan.pixels()),
      max_bad_fraction_(static_cast<float>(options.max_bad_fraction)),
      measures_ahead_(options.measure_ahead),
      lenslet_(plan.spots.rows(), plan.spots.cols()),
      reach_px_(static_cast<float>(spot_reach_px(sensor.grid.pitch_px()))),
      off_x_px_(plan.spots.rows(), plan.spots.cols()),
      off_y_px_(plan.spots.rows(), plan.spots.cols()),
      middle_x_px_(plan.spots.rows(), plan.spots.cols()),
      middle_y_px_(plan.spots.rows(), plan.spots.cols()),
      windows_(plan.spots),
      centred_(plan.spots),
      strips_(plan.strips),
      blocks_(level_plan.pixels()),
      moved_x_px_(plan.spots.rows(), plan.spots.cols()),
      moved_y_px_(plan.spots.rows(), plan.spots.cols()),
      block_rows_needed_(as_size(plan.spots.rows()) + 1),
      rows_needed_(as_size(plan.spots.rows())),
      row_changed_(as_size(plan.spots.rows())),
      level_(plan.spots.rows(), plan.spots.cols()),
      model_x_px_(plan.spots.rows(), plan.spots.cols()),
      model_y_px_(plan.spots.rows(), plan.spots.cols()),
      off_centre_(plan.spots.rows(), plan.spots.cols()),
      due_(plan.spots.rows(), plan.spots.cols()),
      first_look_(plan.spots.rows(), plan.spots.cols()) {
  LowOrders to_middles;  // from where four lenslets meet
  to_middles.x[0] = static_cast<float>(0.5 * (sensor.grid.p11 + sensor.grid.p12));
  to_middles.y[0] = static_cast<float>(0.5 * (sensor.grid.p21 + sensor.grid.p22));
  level_plan.place(plan, to_middles, middle_blocks_);
  const auto find_off = [](float ref_px, int start, int length) {
    return static_cast<float>(off_middle_px(static_cast<double>(ref_px), start, length));
  };
  for (std::size_t k = 0; k < lenslet_.size(); ++k) {
    lenslet_[k] = plan.spots[k].state != LensletState::kUnlit ? 1 : 0;
    if (lenslet_[k] == 0) continue;
    middle_x_px_[k] = sensor.ref_x_px[k];
    middle_y_px_[k] = sensor.ref_y_px[k];
    if (sensor.bend2_x.empty()) continue;
    const Window& window = sensor.window[k];
    off_x_px_[k] = find_off(sensor.ref_x_px[k], window.x0, window.w);
    off_y_px_[k] = find_off(sensor.ref_y_px[k], window.y0, window.h);
    middle_x_px_[k] -= off_x_px_[k];
    middle_y_px_[k] -= off_y_px_[k];
  }
  for (int c = 0; c < plan.spots.cols(); ++c)
    column_u_.push_back(model_coordinate(static_cast<float>(c), plan.spots.cols()));
  if (measures_ahead_) count_rows_needed(level_plan);
  if (plan.gain.empty()) return;
  bad_pixels_ = PixelCounter(plan.frame_rows, plan.frame_cols);
  for (int y = 0; y < plan.frame_rows; ++y)
    for (int x = 0; x < plan.frame_cols; ++x)
      if (!(plan.gain(y, x) > 0.0F)) bad_pixels_.mark(y, x);
}

bool WindowFollower::has_bad_window(const CentroidPlan::Spot& spot) const noexcept {
  if (bad_pixels_.empty()) return false;
  const int bad = bad_pixels_.count(spot.x0, spot.y0, spot.w, spot.h);
  return static_cast<float>(bad) > max_bad_fraction_ * static_cast<float>(spot.w * spot.h);
}

/// Moves lenslet k's window of `windows` by whole pixels from where the calibration put it. What
/// would leave the frame is held in it, and is lost where that is more than spots may be off.
void WindowFollower::place_window(const CentroidPlan& plan, std::size_t k, int dx, int dy,
                                  Image<CentroidPlan::Spot>& windows) const noexcept {
  const CentroidPlan::Spot& home = plan.spots[k];
  CentroidPlan::Spot& spot = windows[k];
  const int back_x = back_into(home.x0 + dx, home.w, plan.frame_cols);
  const int back_y = back_into(home.y0 + dy, home.h, plan.frame_rows);
  dx += back_x;
  dy += back_y;
  spot.x0 = home.x0 + dx;
  spot.y0 = home.y0 + dy;
  if (static_cast<float>(std::max(std::abs(back_x), std::abs(back_y))) > kCutOff * pitch_px_)
    spot.state = LensletState::kLost;
  else if (dx == 0 && dy == 0)
    spot.state = home.state;
  else
    spot.state = has_bad_window(spot) ? LensletState::kBadPixels : LensletState::kValid;
}

/// Moves the windows by the model's displacements, in whole pixels; where gains are bent, so that
/// the spots lie within half a pixel of the windows' middles.
void WindowFollower::place_windows(const CentroidPlan& plan, const LevelPlan& level_plan,
                                   const LowOrders& model) noexcept {
  model_ = model;
  level_plan.place(plan, model, blocks_, team_);
  const int rows = windows_.rows(), cols = windows_.cols();
  const float limit = 4.0F * pitch_px_;  // What is extrapolated into the dark may be anything.
  const auto place_row = [&](int r) {
    const LowOrders::Row row = model.along(model_coordinate(static_cast<float>(r), rows));
    for (int c = 0; c < cols; ++c) {
      const std::size_t k = as_size(r) * as_size(cols) + as_size(c);
      const auto [x, y] = row.at(column_u_[as_size(c)]);
      model_x_px_[k] = std::clamp(x, -limit, limit);
      model_y_px_[k] = std::clamp(y, -limit, limit);
      if (lenslet_[k] == 0) continue;
      place_window(plan, k, round_to_int(model_x_px_[k] + off_x_px_[k]),
                   round_to_int(model_y_px_[k] + off_y_px_[k]), windows_);
      moved_x_px_[k] = static_cast<float>(windows_[k].x0 - plan.spots[k].x0);
      moved_y_px_[k] = static_cast<float>(windows_[k].y0 - plan.spots[k].y0);
    }
  };
  share_rows(team_, 0, rows, [&](int, int first, int last) {
    for (int r = first; r < last; ++r) place_row(r);
  });
  centred_ = windows_;
  off_centre_.fill(0);
  strips_.place(windows_, plan.frame_cols);
  if (measures_ahead_) count_rows_needed(level_plan);
}

/// Measures the level where no spot is, wherever the spots are: at the corners between the windows
/// and in their middles, of which the lower counts.
void WindowFollower::measure_lower_level(const LevelPlan& level_plan, FrameView frame,
                                         FrameLevels& levels) noexcept {
  measure_levels(level_plan, level_plan.pixels(), frame, levels);
  level_ = levels.level;
  const float threshold = levels.threshold, pixel_variance = levels.pixel_variance;
  measure_levels(level_plan, middle_blocks_, frame, levels);
  for (std::size_t k = 0; k < level_.size(); ++k)
    levels.level[k] = std::min(levels.level[k], level_[k]);
  levels.threshold = std::min(levels.threshold, threshold);
  levels.pixel_variance = std::min(levels.pixel_variance, pixel_variance);
}

AcquisitionResult WindowFollower::acquire(const CentroidPlan& plan, const LevelPlan& level_plan,
                                          FrameView frame, FrameLevels& levels,
                                          const SharpPixels& sharp, LowOrders& model) noexcept {
  const Image<std::uint8_t>& lit = judge_.lit();
  SpotHistory history{.lit = lit};
  int n = 0;
  for (std::size_t k = 0; k < lit.size(); ++k) {
    if (lit[k] == 0) continue;
    history.mean_px[0] += model_x_px_[k];
    history.mean_px[1] += model_y_px_[k];
    ++n;
  }
  for (float& mean : history.mean_px) mean /= static_cast<float>(std::max(n, 1));
  measure_lower_level(level_plan, frame, levels);
  return acquisition_.find(plan, frame, {&levels, &sharp}, history, model);
}

bool WindowFollower::is_settled(const SpotFit& found) const noexcept {
  return judge_.is_believed(found) && found.largest_px <= kFollowed * pitch_px_ && found.same_lit;
}

FollowerMemory WindowFollower::memory() const {
  return {.frames = frames_,
          .started = judge_.started(),
          .model = model_,
          .seen = judge_.seen(),
          .level = forecast_};
}

void WindowFollower::recall(const CentroidPlan& plan, const LevelPlan& level_plan,
                            const FollowerMemory& memory) {
  check_size("WindowFollower", "remembered lenslets", size_of(memory.seen), size_of(lenslet_));
  frames_ = memory.frames;
  judge_.recall(memory.started, memory.seen);
  forecast_ = memory.level;
  place_windows(plan, level_plan, memory.model);
}

/// Returns where the windows belong for spots of these low orders, whatever they were before.
LowOrders WindowFollower::settled_model(const LowOrders& spots) const noexcept {
  const int rows = lenslet_.rows(), cols = lenslet_.cols();
  float largest_px = 0.0F;
  for (int r = 0; r < rows; ++r) {
    const LowOrders::Row row = spots.along(model_coordinate(static_cast<float>(r), rows));
    for (int c = 0; c < cols; ++c) {
      if (lenslet_(r, c) == 0) continue;
      const auto [x, y] = row.at(column_u_[as_size(c)]);
      largest_px = std::max(largest_px, std::max(std::abs(x), std::abs(y)));
    }
  }
  LowOrders model;
  if (largest_px <= std::min(kHome * pitch_px_, followed_px_)) return model;
  const float step_px = kRounded * pitch_px_;
  for (std::size_t i = 0; i < model.x.size(); ++i) {
    model.x[i] = step_px * std::round(spots.x[i] / step_px) + 0.0F;  // no −0
    model.y[i] = step_px * std::round(spots.y[i] / step_px) + 0.0F;
  }
  return model;
}

FollowState WindowFollower::measure(const CentroidPlan& plan, const LevelPlan& level_plan,
                                    const SharpPixelPlan& sharp_plan, FrameView frame,
                                    FrameLevels& levels, SharpPixels& sharp, Centroids& centroids,
                                    Team* team) noexcept {
  check_size("WindowFollower", "lenslets", size_of(windows_), size_of(plan.spots));
  team_ = team;
  SpotFit found;
  const FollowState state =
      measure_frame(plan, level_plan, sharp_plan, frame, levels, sharp, centroids, found);
  forecast_ = next_forecast_;
  if (++frames_ % kSettlingFrames == 0 && state != FollowState::kLost &&
      state != FollowState::kNoLight) {
    const LowOrders model = settled_model(found.model += model_);
    if (model.x != model_.x || model.y != model_.y) place_windows(plan, level_plan, model);
  }
  team_ = nullptr;
  return state;
}

FollowState WindowFollower::measure_frame(const CentroidPlan& plan, const LevelPlan& level_plan,
                                          const SharpPixelPlan& sharp_plan, FrameView frame,
                                          FrameLevels& levels, SharpPixels& sharp,
                                          Centroids& centroids, SpotFit& found) noexcept {
  const Centroids* looked = &centroids;
  auto witnesses = SpotJudge::Witnesses::kValid;
  const auto look = [&] { judge_.look_at({model_x_px_, model_y_px_}, *looked, witnesses, found); };
  const auto measure_at = [&](const LowOrders& model) {
    place_windows(plan, level_plan, model);
    measure_levels(level_plan, blocks_, frame, levels, team_);
    go_by_forecast(level_plan, levels);
    assign_sharp_pixels(sharp_plan, plan, windows_, frame, levels, sharp);
    find_centroids(plan, frame, centroids,
                   {&levels, &sharp, &windows_, nullptr, &strips_, false, team_});
    std::fill(row_changed_.begin(), row_changed_.end(), std::uint8_t{1});
    tell_windows(centroids);
    looked = &centroids;
    look();
  };
  const auto finish = [&](FollowState state) {
    centroids.n_lost = static_cast<int>(
        std::count(centroids.state.begin(), centroids.state.end(), LensletState::kLost));
    return state;
  };
  const auto moved = [&](LowOrders by) { return by += model_; };

  looked = &measure_spots(plan, level_plan, sharp_plan, frame, levels, sharp, centroids);
  look();
  const auto is_near = [&] { return found.largest_px <= kStep * pitch_px_; };
  const auto is_faint = [&] {
    return witnesses == SpotJudge::Witnesses::kFaintToo && judge_.is_faint_beam(found) && is_near();
  };
  if (judge_.may_be_faint(found) && leaves_dark_windows_empty(plan, levels)) {
    witnesses = SpotJudge::Witnesses::kFaintToo;
    look();
    if (!is_faint()) {
      witnesses = SpotJudge::Witnesses::kValid;
      look();
    }
  }
  FollowState state = FollowState::kSettled;
  if (judge_.is_believed(found) && found.same_lit && found.largest_px > followed_px_ && is_near()) {
    state = FollowState::kMoved;
    measure_at(moved(found.model));
  }
  if (!is_settled(found) && !is_faint()) {
    witnesses = SpotJudge::Witnesses::kValid;
    const LowOrders before = model_;
    LowOrders model;
    state = FollowState::kAcquired;
    const AcquisitionResult result = acquire(plan, level_plan, frame, levels, sharp, model);
    if (result == AcquisitionResult::kFound) {
      measure_at(model);
      if (is_near()) measure_at(moved(found.model));
    }
    if (result != AcquisitionResult::kFound || !judge_.is_believed(found)) {
      measure_at(before);
      const bool dark = result == AcquisitionResult::kNoLight;
      SpotJudge::lose_all(dark, centroids);
      return finish(dark ? FollowState::kNoLight : FollowState::kLost);
    }
  }
  centre_spots(plan, sharp_plan, frame, levels, sharp, *looked, centroids);
  judge_.judge(centroids, row_changed_);
  if (!is_faint()) judge_.remember(centroids);
  foreign_light_.mark(levels, centroids, row_changed_);
  find_core_positions(plan, frame, centroids,
                      {.levels = &levels, .sharp = &sharp, .windows = &windows_, .team = team_});
  if (plan.core_threshold > 0.0F)
    std::fill(row_changed_.begin(), row_changed_.end(), std::uint8_t{1});
  return finish(state);
}

}  // namespace curlew
