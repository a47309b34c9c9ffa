#include "centroiding/window_follower.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>

#include "core/as_size.h"
#include "core/median.h"
#include "core/size_check.h"

namespace curlew {
namespace {

// All distances are in pitches.
constexpr float kFollowed = 0.15F;    // Windows stay while the spots' low orders are within this.
constexpr float kCentred = 0.1F;      // A spot farther from its window's middle gets it centred.
constexpr float kCutOff = 0.2F;       // A window that the frame holds back by more loses light.
constexpr float kHome = 0.1F;         // Windows settle at home if the low orders are within this,
constexpr float kRounded = 0.025F;    // and else at low orders that are multiples of this.
constexpr float kStep = 0.3F;         // The windows are moved this far without a new search.
constexpr float kNear = 0.42F;        // A spot farther from the fit is another lenslet's.
constexpr float kSurelyNear = 0.3F;   // One nearer than this never is.
constexpr float kResiduals = 6.0F;    // between these, this many times the rms
constexpr float kOfUniform = 0.7F;    // second moments over those of an evenly lit window
constexpr float kSurelyAlone = 0.1F;  // A spot beside lost ones must be as near as this.
// A spot's flux over its reference's, where the median lenslet's is 1: between stray light and
// glare.
constexpr float kDimmest = 0.15F;
constexpr float kBrightest = 10.0F;
constexpr float kLeastSpots = 0.45F;  // of the lenslets with light, for the fit to be believed
// The rms of spots that lie anywhere is .25; strong turbulence leaves .1.
constexpr float kRandom = 0.2F;
constexpr int kEnoughLight = 4;  // lenslets, at least
constexpr std::size_t kMaxSample = 256;
constexpr std::int8_t kSeenMax = 8;  // frames after which a lenslet's light is believed or not

// What a lenslet's window holds.
constexpr std::uint8_t kNothing = 0;     ///< no spot, or none that is known to be another's
constexpr std::uint8_t kNearModel = 1;   ///< a spot near the model, but dim, glaring or wide
constexpr std::uint8_t kWellFormed = 2;  ///< a spot near the model
constexpr std::uint8_t kFarOff = 3;      ///< light too far from the model to be the lenslet's spot

bool is_spot(std::uint8_t what) noexcept { return what == kNearModel || what == kWellFormed; }

bool has_light(LensletState state) noexcept {
  return state == LensletState::kValid || state == LensletState::kAtEdge ||
         state == LensletState::kSaturated;
}

/// Rims are uncertain by a few lenslets; a step of a pitch changes whole sides.
float rim_slack(int lit) noexcept { return 0.3F * std::sqrt(static_cast<float>(lit)) + 1.0F; }

void lose(Centroids& centroids, std::size_t k) noexcept {
  if (centroids.state[k] == LensletState::kValid) --centroids.n_valid;
  centroids.state[k] = LensletState::kLost;
}

/// What is in the window says nothing of where the lenslet's spot is.
void darken(Centroids& centroids, std::size_t k) noexcept {
  if (centroids.state[k] == LensletState::kValid) --centroids.n_valid;
  centroids.state[k] = LensletState::kFaint;
  centroids.flux_adu[k] = 0.0F;
}

/// Returns how far a window of length `n` from `start` must be moved to lie in [0, length).
int back_into(int start, int n, int length) noexcept {
  return std::clamp(start, 0, length - n) - start;
}

}  // namespace

WindowFollower::WindowFollower(const Sensor& sensor, const CentroidPlan& plan,
                               const LevelPlan& level_plan, const CentroidOptions& options)
    : acquisition_(sensor, plan),
      pitch_px_(static_cast<float>(sensor.grid.pitch_px())),
      middle_blocks_(level_plan.pixels()),
      max_bad_fraction_(static_cast<float>(options.max_bad_fraction)),
      lenslet_(plan.spots.rows(), plan.spots.cols()),
      ref_x_px_(sensor.ref_x_px),
      ref_y_px_(sensor.ref_y_px),
      flux_adu_(sensor.flux_adu),
      windows_(plan.spots),
      strips_(plan.strips),
      blocks_(level_plan.pixels()),
      moved_x_px_(plan.spots.rows(), plan.spots.cols()),
      moved_y_px_(plan.spots.rows(), plan.spots.cols()),
      seen_(plan.spots.rows(), plan.spots.cols()),
      lit_(plan.spots.rows(), plan.spots.cols()),
      level_(plan.spots.rows(), plan.spots.cols()),
      model_x_px_(plan.spots.rows(), plan.spots.cols()),
      model_y_px_(plan.spots.rows(), plan.spots.cols()),
      spot_(plan.spots.rows(), plan.spots.cols()),
      off_centre_(plan.spots.rows(), plan.spots.cols()) {
  LowOrders to_middles;  // from where four lenslets meet
  to_middles.x[0] = static_cast<float>(0.5 * (sensor.grid.p11 + sensor.grid.p12));
  to_middles.y[0] = static_cast<float>(0.5 * (sensor.grid.p21 + sensor.grid.p22));
  level_plan.place(plan, to_middles, middle_blocks_);
  std::vector<std::size_t> all;
  for (std::size_t k = 0; k < lenslet_.size(); ++k) {
    lenslet_[k] = plan.spots[k].state != LensletState::kUnlit ? 1 : 0;
    if (lenslet_[k] != 0) all.push_back(k);
  }
  lit_ = lenslet_;
  // The sample begins a lenslet further on in each row, so that it is spread over all columns.
  const std::size_t stride = all.size() / kMaxSample + 1;
  for (std::size_t i = 0; i < all.size(); ++i)
    if ((i + i / as_size(plan.spots.cols())) % stride == 0) sample_.push_back(all[i]);
  values_.reserve(sample_.size());
  near_.resize(sample_.size());
  for (int c = 0; c < plan.spots.cols(); ++c)
    column_u_.push_back(model_coordinate(static_cast<float>(c), plan.spots.cols()));
  if (plan.gain.empty()) return;
  bad_pixels_ = Image<std::int32_t>(plan.frame_rows + 1, plan.frame_cols + 1);
  for (int y = 0; y < plan.frame_rows; ++y)
    for (int x = 0; x < plan.frame_cols; ++x)
      bad_pixels_(y + 1, x + 1) = bad_pixels_(y, x + 1) + bad_pixels_(y + 1, x) -
                                  bad_pixels_(y, x) + (plan.gain(y, x) > 0.0F ? 0 : 1);
}

bool WindowFollower::has_bad_window(const CentroidPlan::Spot& spot) const noexcept {
  if (bad_pixels_.empty()) return false;
  const int x1 = spot.x0 + spot.w, y1 = spot.y0 + spot.h;
  const int bad = bad_pixels_(y1, x1) - bad_pixels_(spot.y0, x1) - bad_pixels_(y1, spot.x0) +
                  bad_pixels_(spot.y0, spot.x0);
  return static_cast<float>(bad) > max_bad_fraction_ * static_cast<float>(spot.w * spot.h);
}

/// Moves lenslet k's window by whole pixels from where the calibration put it. What would leave the
/// frame is held in it, and is lost where that is more than spots may be off.
void WindowFollower::place_window(const CentroidPlan& plan, std::size_t k, int dx,
                                  int dy) noexcept {
  const CentroidPlan::Spot& home = plan.spots[k];
  CentroidPlan::Spot& spot = windows_[k];
  const int back_x = back_into(home.x0 + dx, home.w, plan.frame_cols);
  const int back_y = back_into(home.y0 + dy, home.h, plan.frame_rows);
  dx += back_x;
  dy += back_y;
  spot.x0 = home.x0 + dx;
  spot.y0 = home.y0 + dy;
  moved_x_px_[k] = static_cast<float>(dx);
  moved_y_px_[k] = static_cast<float>(dy);
  if (static_cast<float>(std::max(std::abs(back_x), std::abs(back_y))) > kCutOff * pitch_px_)
    spot.state = LensletState::kLost;
  else if (dx == 0 && dy == 0)
    spot.state = home.state;
  else
    spot.state = has_bad_window(spot) ? LensletState::kBadPixels : LensletState::kValid;
}

/// Moves the windows by the model's displacements, in whole pixels.
void WindowFollower::place_windows(const CentroidPlan& plan, const LevelPlan& level_plan,
                                   const LowOrders& model) noexcept {
  model_ = model;
  level_plan.place(plan, model, blocks_);
  const int rows = windows_.rows(), cols = windows_.cols();
  const float limit = 4.0F * pitch_px_;  // What is extrapolated into the dark may be anything.
  for (int r = 0; r < rows; ++r) {
    const LowOrders::Row row = model.along(model_coordinate(static_cast<float>(r), rows));
    for (int c = 0; c < cols; ++c) {
      const std::size_t k = as_size(r) * as_size(cols) + as_size(c);
      const auto [x, y] = row.at(column_u_[as_size(c)]);
      model_x_px_[k] = std::clamp(x, -limit, limit);
      model_y_px_[k] = std::clamp(y, -limit, limit);
      if (lenslet_[k] != 0)
        place_window(plan, k, static_cast<int>(std::lround(model_x_px_[k])),
                     static_cast<int>(std::lround(model_y_px_[k])));
    }
  }
  strips_.place(windows_, plan.frame_cols);
}

/// Centres the windows of spots that lie off their middle, for this frame only. Returns whether
/// there are any; off_centre_ says which.
bool WindowFollower::centre_windows(const CentroidPlan& plan, const Centroids& centroids) noexcept {
  const float near_px = kCentred * pitch_px_;
  bool any = false;
  for (std::size_t k = 0; k < spot_.size(); ++k) {
    off_centre_[k] = 0;
    if (!is_spot(spot_[k])) continue;
    const float x = centroids.x_px[k] - ref_x_px_[k] - moved_x_px_[k];
    const float y = centroids.y_px[k] - ref_y_px_[k] - moved_y_px_[k];
    if (x * x + y * y <= near_px * near_px) continue;
    off_centre_[k] = 1;
    any = true;
    place_window(plan, k, static_cast<int>(std::lround(moved_x_px_[k] + x)),
                 static_cast<int>(std::lround(moved_y_px_[k] + y)));
  }
  return any;
}

/// Puts windows that were centred on their spots back to where the model has them.
void WindowFollower::return_windows(const CentroidPlan& plan) noexcept {
  for (std::size_t k = 0; k < off_centre_.size(); ++k) {
    if (off_centre_[k] == 0) continue;
    off_centre_[k] = 0;
    place_window(plan, k, static_cast<int>(std::lround(model_x_px_[k])),
                 static_cast<int>(std::lround(model_y_px_[k])));
  }
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
  SpotHistory history{.lit = lit_};
  int n = 0;
  for (std::size_t k = 0; k < lit_.size(); ++k) {
    if (lit_[k] == 0) continue;
    history.mean_px[0] += model_x_px_[k];
    history.mean_px[1] += model_y_px_[k];
    ++n;
  }
  for (float& mean : history.mean_px) mean /= static_cast<float>(std::max(n, 1));
  measure_lower_level(level_plan, frame, levels);
  return acquisition_.find(plan, frame, {&levels, &sharp}, history, model);
}

/// Fits the low orders to a sample of the spots, first of those that may be their lenslets', then
/// of those that lie near the others.
void WindowFollower::fit(const Centroids& centroids, Fit& found) noexcept {
  constexpr float kSigmaOfMedian = 0.849F;  // of the square of two axes: 1/√(2 ln 2)
  const int rows = windows_.rows(), cols = windows_.cols();
  float near2 = (kNear * pitch_px_) * (kNear * pitch_px_);
  found.model = {};
  const auto place_of = [&](std::size_t k) {
    const int r = static_cast<int>(k / as_size(cols));
    return std::array<float, 4>{column_u_[k % as_size(cols)],
                                model_coordinate(static_cast<float>(r), rows),
                                centroids.x_px[k] - ref_x_px_[k] - model_x_px_[k],
                                centroids.y_px[k] - ref_y_px_[k] - model_y_px_[k]};
  };
  for (int pass = 0; pass < 2; ++pass) {
    bool same = pass > 0;  // the spots that are near are those of the pass before
    values_.clear();
    for (std::size_t i = 0; i < sample_.size(); ++i) {
      bool near = centroids.state[sample_[i]] == LensletState::kValid;
      if (near) {
        const auto [u, v, x, y] = place_of(sample_[i]);
        const auto [at_x, at_y] = found.model.at(u, v);
        const float square = (x - at_x) * (x - at_x) + (y - at_y) * (y - at_y);
        near = square <= near2;
        if (near) values_.push_back(square);
      }
      same = same && near == (near_[i] != 0);
      near_[i] = near ? 1 : 0;
    }
    if (values_.empty()) return;
    if (!same) {
      LowOrdersFit fit;
      for (std::size_t i = 0; i < sample_.size(); ++i) {
        if (near_[i] == 0) continue;
        const auto [u, v, x, y] = place_of(sample_[i]);
        fit.add(u, v, x, y);
      }
      found.model = fit.solve();
    }
    found.residual_px = kSigmaOfMedian * std::sqrt(median_of(std::span(values_)));
    const float limit = std::max(3.0F * found.residual_px, 0.1F * pitch_px_);
    near2 = std::min(near2, 2.0F * limit * limit);
  }
}

/// Marks the lenslets whose spot lies near the model, and counts.
void WindowFollower::find_spots(const Centroids& centroids, Fit& found) noexcept {
  const int rows = windows_.rows(), cols = windows_.cols();
  const float near_px =
      std::clamp(kResiduals * found.residual_px, kSurelyNear * pitch_px_, kNear * pitch_px_);
  const bool scattered = kResiduals * found.residual_px > kNear * pitch_px_;
  const float surely_px = std::max(kResiduals * found.residual_px, kSurelyAlone * pitch_px_);
  std::vector<float>& ratios = values_;
  ratios.clear();
  for (const std::size_t k : sample_)
    if (centroids.state[k] == LensletState::kValid && flux_adu_[k] > 0.0F)
      ratios.push_back(centroids.flux_adu[k] / flux_adu_[k]);
  const float typical = ratios.empty() ? 0.0F : median_of(std::span(ratios));
  found.spots = found.light = 0;
  found.largest_px = 0.0F;
  int same = 0;
  int were_lit = 0;
  for (int r = 0; r < rows; ++r) {
    const LowOrders::Row row = found.model.along(model_coordinate(static_cast<float>(r), rows));
    for (int c = 0; c < cols; ++c) {
      const std::size_t k = as_size(r) * as_size(cols) + as_size(c);
      const LensletState state = centroids.state[k];
      spot_[k] = kNothing;
      were_lit += lit_[k];
      found.light += has_light(state) ? 1 : 0;
      const bool weak = state == LensletState::kAtEdge ||
                        (state == LensletState::kFaint && centroids.flux_adu[k] > 0.0F);
      if (state != LensletState::kValid && !weak) continue;
      const auto [at_x, at_y] = row.at(column_u_[as_size(c)]);
      const float x = centroids.x_px[k] - ref_x_px_[k] - model_x_px_[k] - at_x;
      const float y = centroids.y_px[k] - ref_y_px_[k] - model_y_px_[k] - at_y;
      const float square = x * x + y * y;
      // Where spots scatter widely anyway, a weak one may be anywhere in its window.
      if (square > near_px * near_px && !(weak && scattered)) spot_[k] = kFarOff;
      if (weak || spot_[k] == kFarOff) continue;
      found.largest_px = std::max(found.largest_px, std::max(std::abs(at_x), std::abs(at_y)));
      const CentroidPlan::Spot& window = windows_[k];
      const float uniform =
          static_cast<float>(window.w * window.w + window.h * window.h - 2) / 12.0F;
      const float flux = centroids.flux_adu[k];
      const float expected = typical * flux_adu_[k];
      const bool well = centroids.xx_px2[k] + centroids.yy_px2[k] < kOfUniform * uniform &&
                        flux > kDimmest * expected && flux < kBrightest * expected &&
                        square < surely_px * surely_px;
      spot_[k] = well ? kWellFormed : kNearModel;
      found.spots += well ? 1 : 0;
      same += lit_[k];
    }
  }
  found.same_lit = static_cast<float>(were_lit - same) <= rim_slack(were_lit) || !has_stepped(same);
}

/// Returns whether the lenslets with a spot are about as much those that were lit, a pitch away, as
/// they are those that were lit. `here` is how many of these are.
bool WindowFollower::has_stepped(int here) const noexcept {
  const int rows = lit_.rows(), cols = lit_.cols();
  for (int i = -1; i <= 1; ++i) {
    for (int j = -1; j <= 1; ++j) {
      if (i == 0 && j == 0) continue;
      int n = 0;
      for (int r = std::max(0, -i); r < std::min(rows, rows - i); ++r)
        for (int c = std::max(0, -j); c < std::min(cols, cols - j); ++c)
          n += lit_(r, c) != 0 && is_spot(spot_(r + i, c + j)) ? 1 : 0;
      if (static_cast<float>(n) >= static_cast<float>(here) - 0.5F * rim_slack(here)) return true;
    }
  }
  return false;
}

bool WindowFollower::is_believed(const Fit& found) const noexcept {
  return found.spots >= kEnoughLight && found.residual_px <= kRandom * pitch_px_ &&
         static_cast<float>(found.spots) >= kLeastSpots * static_cast<float>(found.light);
}

bool WindowFollower::is_settled(const Fit& found) const noexcept {
  return is_believed(found) && found.largest_px <= kFollowed * pitch_px_ && found.same_lit;
}

/// Returns which part of the lenslet's neighbours has a well-formed spot.
float WindowFollower::kept_neighbours(int row, int col) const noexcept {
  int all = 0;
  int kept = 0;
  for (int r = std::max(row - 1, 0); r <= std::min(row + 1, spot_.rows() - 1); ++r) {
    for (int c = std::max(col - 1, 0); c <= std::min(col + 1, spot_.cols() - 1); ++c) {
      if (lenslet_(r, c) == 0 || (r == row && c == col)) continue;
      ++all;
      kept += spot_(r, c) == kWellFormed ? 1 : 0;
    }
  }
  return all > 0 ? static_cast<float>(kept) / static_cast<float>(all) : 0.0F;
}

void WindowFollower::judge(Centroids& centroids) const noexcept {
  constexpr float kAmongSpots = 0.75F;
  constexpr float kForDark = 0.5F;
  constexpr float kAlone = 0.25F;
  for (int r = 0; r < spot_.rows(); ++r) {
    for (int c = 0; c < spot_.cols(); ++c) {
      const std::size_t k = as_size(r) * as_size(spot_.cols()) + as_size(c);
      const LensletState state = centroids.state[k];
      if (state != LensletState::kValid && state != LensletState::kFaint &&
          state != LensletState::kAtEdge)
        continue;
      // Where a lenslet had its spot in one of the last frames, light fell before and may again.
      const float kept = seen_[k] > 0 ? 1.0F : kept_neighbours(r, c);
      const float needed = spot_[k] == kWellFormed  ? kAlone
                           : spot_[k] == kNearModel ? kAmongSpots
                                                    : kForDark;
      if (kept < needed) {
        lose(centroids, k);
      } else if (spot_[k] == kFarOff) {
        darken(centroids, k);
      }
    }
  }
}

void WindowFollower::remember(const Centroids& centroids) noexcept {
  for (std::size_t k = 0; k < seen_.size(); ++k) {
    const bool has = centroids.state[k] == LensletState::kValid;
    if (!started_)
      seen_[k] = has ? kSeenMax : 0;
    else
      seen_[k] = static_cast<std::int8_t>(std::clamp(seen_[k] + (has ? 1 : -1), 0, +kSeenMax));
  }
  started_ = true;
  mark_lit();
}

void WindowFollower::mark_lit() noexcept {
  for (std::size_t k = 0; k < seen_.size(); ++k) lit_[k] = 2 * seen_[k] > kSeenMax ? 1 : 0;
}

FollowerMemory WindowFollower::memory() const {
  return {.frames = frames_, .started = started_, .model = model_, .seen = seen_};
}

void WindowFollower::recall(const CentroidPlan& plan, const LevelPlan& level_plan,
                            const FollowerMemory& memory) {
  check_size("WindowFollower", "remembered lenslets", size_of(memory.seen), size_of(seen_));
  frames_ = memory.frames;
  started_ = memory.started;
  seen_ = memory.seen;
  if (started_)
    mark_lit();
  else
    lit_ = lenslet_;
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
  if (largest_px <= kHome * pitch_px_) return model;
  const float step_px = kRounded * pitch_px_;
  for (std::size_t i = 0; i < model.x.size(); ++i) {
    model.x[i] = step_px * std::round(spots.x[i] / step_px) + 0.0F;  // no −0
    model.y[i] = step_px * std::round(spots.y[i] / step_px) + 0.0F;
  }
  return model;
}

FollowState WindowFollower::measure(const CentroidPlan& plan, const LevelPlan& level_plan,
                                    const SharpPixelPlan& sharp_plan, FrameView frame,
                                    FrameLevels& levels, SharpPixels& sharp,
                                    Centroids& centroids) noexcept {
  check_size("WindowFollower", "lenslets", size_of(windows_), size_of(plan.spots));
  Fit found;
  const FollowState state =
      measure_frame(plan, level_plan, sharp_plan, frame, levels, sharp, centroids, found);
  if (++frames_ % kSettlingFrames != 0) return state;
  if (state == FollowState::kLost || state == FollowState::kNoLight) return state;
  const LowOrders model = settled_model(found.model += model_);
  if (model.x != model_.x || model.y != model_.y) place_windows(plan, level_plan, model);
  return state;
}

FollowState WindowFollower::measure_frame(const CentroidPlan& plan, const LevelPlan& level_plan,
                                          const SharpPixelPlan& sharp_plan, FrameView frame,
                                          FrameLevels& levels, SharpPixels& sharp,
                                          Centroids& centroids, Fit& found) noexcept {
  const auto measure_here = [&] {
    find_centroids(plan, frame, centroids, {&levels, &sharp, &windows_, nullptr, &strips_});
    fit(centroids, found);
    find_spots(centroids, found);
  };
  const auto measure_at = [&](const LowOrders& model) {
    place_windows(plan, level_plan, model);
    measure_levels(level_plan, blocks_, frame, levels);
    assign_sharp_pixels(sharp_plan, plan, windows_, frame, levels, sharp);
    measure_here();
  };
  const auto finish = [&](FollowState state) {
    centroids.low_x_px = model_x_px_;
    centroids.low_y_px = model_y_px_;
    centroids.moved_x_px = moved_x_px_;
    centroids.moved_y_px = moved_y_px_;
    centroids.n_lost = static_cast<int>(
        std::count(centroids.state.begin(), centroids.state.end(), LensletState::kLost));
    return_windows(plan);
    return state;
  };
  const auto moved = [&](LowOrders by) { return by += model_; };

  measure_levels(level_plan, blocks_, frame, levels);
  find_sharp_pixels(sharp_plan, plan, windows_, frame, levels, sharp);
  measure_here();
  FollowState state = FollowState::kSettled;
  if (!is_settled(found) && is_believed(found) && found.same_lit &&
      found.largest_px <= kStep * pitch_px_) {
    state = FollowState::kMoved;
    measure_at(moved(found.model));
  }
  if (!is_settled(found)) {
    const LowOrders before = model_;
    LowOrders model;
    state = FollowState::kAcquired;
    const AcquisitionResult result = acquire(plan, level_plan, frame, levels, sharp, model);
    if (result == AcquisitionResult::kFound) {
      measure_at(model);
      if (found.largest_px <= kStep * pitch_px_) measure_at(moved(found.model));
    }
    if (result != AcquisitionResult::kFound || !is_believed(found)) {
      measure_at(before);
      const bool dark = result == AcquisitionResult::kNoLight;
      for (std::size_t k = 0; k < lit_.size(); ++k) {
        if (has_light(centroids.state[k]))
          lose(centroids, k);
        else if (centroids.state[k] == LensletState::kFaint)
          dark ? darken(centroids, k) : lose(centroids, k);
      }
      return finish(dark ? FollowState::kNoLight : FollowState::kLost);
    }
  }
  if (centre_windows(plan, centroids)) {
    assign_sharp_pixels(sharp_plan, plan, windows_, frame, levels, sharp);
    find_centroids(plan, frame, centroids, {&levels, &sharp, &windows_, &off_centre_});
  }
  judge(centroids);
  remember(centroids);
  return finish(state);
}

}  // namespace curlew
