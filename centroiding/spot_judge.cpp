#include "centroiding/spot_judge.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <span>

#include "core/as_size.h"
#include "core/median.h"

namespace curlew {
namespace {

// All distances are in pitches.
constexpr float kNear = 0.42F;        // A spot farther from the fit is another lenslet's.
constexpr float kSurelyNear = 0.3F;   // One nearer than this never is.
constexpr float kResiduals = 6.0F;    // between these, this many times the rms
constexpr float kOfUniform = 0.7F;    // second moments over those of an evenly lit window
constexpr float kSurelyAlone = 0.1F;  // A spot beside lost ones must be as near as this.
constexpr float kNarrow = 0.5F;  // A spot's second moments are at least this of the reference's.
constexpr float kWellSampled = 0.8F;  // px², the σ² of spots whose width pixels tell
constexpr float kLeastSpots = 0.45F;  // of the lenslets with light, for the fit to be believed
// The rms of spots that lie anywhere is .25; strong turbulence leaves .1.
constexpr float kRandom = 0.2F;
constexpr int kEnoughLight = 4;  // lenslets, at least
constexpr std::size_t kMaxSample = 256;
constexpr std::int8_t kSeenMax = 8;  // frames after which a lenslet's light is believed or not

// Loops over all lenslets go by bytes and have no branches, so that the compiler makes vectors of
// them.
constexpr auto kValidByte = static_cast<std::uint8_t>(LensletState::kValid);
constexpr auto kFaintByte = static_cast<std::uint8_t>(LensletState::kFaint);
constexpr auto kAtEdgeByte = static_cast<std::uint8_t>(LensletState::kAtEdge);

const std::uint8_t* state_bytes(const Centroids& centroids) noexcept {
  return reinterpret_cast<const std::uint8_t*>(centroids.state.data());
}

bool has_light(LensletState state) noexcept {
  return state == LensletState::kValid || state == LensletState::kAtEdge ||
         state == LensletState::kSaturated;
}

/// Spots that speak for those beside them.
bool is_sure(std::uint8_t mark) noexcept { return mark == kWellFormed || mark == kFaintSpot; }

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

/// Returns the least sum of a spot's second moments; 0 where nothing is known of the spots.
float narrowest_px2(double spot_sigma_px) noexcept {
  const auto variance_px2 = static_cast<float>(spot_sigma_px * spot_sigma_px);
  return variance_px2 >= kWellSampled ? kNarrow * 2.0F * variance_px2 : 0.0F;
}

}  // namespace

SpotJudge::SpotJudge(const Sensor& sensor, const CentroidPlan& plan)
    : pitch_px_(static_cast<float>(sensor.grid.pitch_px())),
      lenslet_(plan.spots.rows(), plan.spots.cols()),
      ref_x_px_(sensor.ref_x_px),
      ref_y_px_(sensor.ref_y_px),
      flux_adu_(sensor.flux_adu),
      widest_px2_(plan.spots.rows(), plan.spots.cols()),
      narrowest_px2_(narrowest_px2(sensor.spot_sigma_px)),
      seen_(plan.spots.rows(), plan.spots.cols()),
      lit_(plan.spots.rows(), plan.spots.cols()),
      spot_(plan.spots.rows(), plan.spots.cols()) {
  std::vector<std::size_t> all;
  for (std::size_t k = 0; k < lenslet_.size(); ++k) {
    lenslet_[k] = plan.spots[k].state != LensletState::kUnlit ? 1 : 0;
    if (lenslet_[k] != 0) all.push_back(k);
    const int w = plan.spots[k].w, h = plan.spots[k].h;
    widest_px2_[k] = kOfUniform * (static_cast<float>(w * w + h * h - 2) / 12.0F);
  }
  lit_ = lenslet_;
  lenslets_ = static_cast<int>(all.size());
  // The sample begins a lenslet further on in each row, so that it is spread over all columns.
  const std::size_t stride = all.size() / kMaxSample + 1;
  for (std::size_t i = 0; i < all.size(); ++i)
    if ((i + i / as_size(plan.spots.cols())) % stride == 0) sample_.push_back(all[i]);
  values_.reserve(sample_.size());
  near_.resize(sample_.size());
  for (int c = 0; c < plan.spots.cols(); ++c)
    column_u_.push_back(model_coordinate(static_cast<float>(c), plan.spots.cols()));
}

void SpotJudge::look_at(const WindowPlaces& places, const Centroids& centroids, Witnesses witnesses,
                        SpotFit& found) noexcept {
  faint_count_ = witnesses == Witnesses::kFaintToo;
  float typical = typical_brightness(centroids, LensletState::kValid);
  if (faint_count_ && typical == 0.0F)
    typical = typical_brightness(centroids, LensletState::kFaint);
  fit(places, centroids, typical, found);
  find_spots(places, centroids, typical, found);
  reject_clumps(centroids, typical, found);
}

/// What noise leaves of a dark window is no faint spot where others are bright.
bool SpotJudge::is_witness(const Centroids& centroids, std::size_t k,
                           float typical) const noexcept {
  const LensletState state = centroids.state[k];
  return state == LensletState::kValid ||
         (faint_count_ && state == LensletState::kFaint && centroids.flux_adu[k] > 0.0F &&
          centroids.flux_adu[k] > kDimmest * typical * flux_adu_[k]);
}

/// Fits the low orders to a sample of the spots, first of those that may be their lenslets', then
/// of those that lie near the others.
void SpotJudge::fit(const WindowPlaces& places, const Centroids& centroids, float typical,
                    SpotFit& found) noexcept {
  constexpr float kSigmaOfMedian = 0.849F;  // of the square of two axes: 1/√(2 ln 2)
  const int rows = spot_.rows(), cols = spot_.cols();
  float near2 = (kNear * pitch_px_) * (kNear * pitch_px_);
  found.model = {};
  found.residual_px = 0.0F;
  const auto place_of = [&](std::size_t k) {
    const int r = static_cast<int>(k / as_size(cols));
    return std::array<float, 4>{column_u_[k % as_size(cols)],
                                model_coordinate(static_cast<float>(r), rows),
                                centroids.x_px[k] - ref_x_px_[k] - places.x_px[k],
                                centroids.y_px[k] - ref_y_px_[k] - places.y_px[k]};
  };
  for (int pass = 0; pass < 2; ++pass) {
    bool same = pass > 0;  // the spots that are near are those of the pass before
    values_.clear();
    for (std::size_t i = 0; i < sample_.size(); ++i) {
      bool near = is_witness(centroids, sample_[i], typical);
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
void SpotJudge::find_spots(const WindowPlaces& places, const Centroids& centroids, float typical,
                           SpotFit& found) noexcept {
  const float near_px =
      std::clamp(kResiduals * found.residual_px, kSurelyNear * pitch_px_, kNear * pitch_px_);
  const float surely_px = std::max(kResiduals * found.residual_px, kSurelyAlone * pitch_px_);
  const SpotLimits limits{.far_px2 = near_px * near_px,
                          .near_px2 = surely_px * surely_px,
                          .typical = typical,
                          // Where spots scatter widely anyway, a weak one may be anywhere.
                          .weak_may_be = kResiduals * found.residual_px > kNear * pitch_px_,
                          .faint_count = faint_count_};
  SpotCounts counts;
  const int rows = spot_.rows();
  const std::size_t cols = as_size(spot_.cols());
  for (int r = 0; r < rows; ++r) {
    const std::size_t k = as_size(r) * cols;
    const SpotRow row{.n = cols,
                      .x = {&centroids.x_px[k], &ref_x_px_[k], &places.x_px[k]},
                      .y = {&centroids.y_px[k], &ref_y_px_[k], &places.y_px[k]},
                      .column_u = column_u_.data(),
                      .flux = &centroids.flux_adu[k],
                      .reference_flux = &flux_adu_[k],
                      .xx = &centroids.xx_px2[k],
                      .yy = &centroids.yy_px2[k],
                      .widest = &widest_px2_[k],
                      .states = state_bytes(centroids) + k,
                      .lit = &lit_[k]};
    mark_spots(row, found.model.along(model_coordinate(static_cast<float>(r), rows)), limits,
               &spot_[k], counts);
  }
  found.spots = counts.spots;
  found.light = counts.light;
  found.faint = counts.faint;
  found.largest_px = std::bit_cast<float>(counts.largest_bits);
  found.same_lit =
      static_cast<float>(counts.were_lit - counts.same) <= rim_slack(counts.were_lit) ||
      !has_stepped(counts.same);
}

/// Returns the median flux over its reference's, of lenslets in this state; 0 where there are none.
float SpotJudge::typical_brightness(const Centroids& centroids, LensletState of) noexcept {
  values_.clear();
  for (const std::size_t k : sample_)
    if (centroids.state[k] == of && centroids.flux_adu[k] > 0.0F && flux_adu_[k] > 0.0F)
      values_.push_back(centroids.flux_adu[k] / flux_adu_[k]);
  return values_.empty() ? 0.0F : median_of(std::span(values_));
}

/// Clumps of hot pixels are narrower than light can be. Where many spots are narrow, they are faint
/// ones, of which the threshold leaves only the tips.
void SpotJudge::reject_clumps(const Centroids& centroids, float typical, SpotFit& found) noexcept {
  constexpr int kFew = 20;  // one of so many lenslets with light
  const float* flux = centroids.flux_adu.data();
  const float* xx = centroids.xx_px2.data();
  const float* yy = centroids.yy_px2.data();
  const auto is_clump = [&](std::size_t k) {
    const int bright = static_cast<int>(flux[k] > typical * flux_adu_[k]);
    const int narrow = static_cast<int>(xx[k] + yy[k] < narrowest_px2_);
    return (static_cast<int>(has_spot(k)) & bright & narrow) != 0;
  };
  int clumps = 0;
  for (std::size_t k = 0; k < spot_.size(); ++k) clumps += is_clump(k) ? 1 : 0;
  if (clumps == 0 || clumps * kFew > found.light) return;
  for (std::size_t k = 0; k < spot_.size(); ++k) {
    if (!is_clump(k)) continue;
    found.spots -= spot_[k] == kWellFormed ? 1 : 0;
    spot_[k] = kFarOff;
  }
}

/// Returns whether the lenslets with a spot are about as much those that were lit, a pitch away, as
/// they are those that were lit. `here` is how many of these are.
bool SpotJudge::has_stepped(int here) const noexcept {
  const int rows = lit_.rows(), cols = lit_.cols();
  for (int i = -1; i <= 1; ++i) {
    for (int j = -1; j <= 1; ++j) {
      if (i == 0 && j == 0) continue;
      int n = 0;
      for (int r = std::max(0, -i); r < std::min(rows, rows - i); ++r)
        for (int c = std::max(0, -j); c < std::min(cols, cols - j); ++c)
          n += lit_(r, c) != 0 && (has_spot(as_size(r + i) * as_size(cols) + as_size(c + j)) ||
                                   spot_(r + i, c + j) == kFaintSpot)
                   ? 1
                   : 0;
      if (static_cast<float>(n) >= static_cast<float>(here) - 0.5F * rim_slack(here)) return true;
    }
  }
  return false;
}

bool SpotJudge::is_believed(const SpotFit& found) const noexcept {
  return found.spots >= kEnoughLight && found.residual_px <= kRandom * pitch_px_ &&
         static_cast<float>(found.spots) >= kLeastSpots * static_cast<float>(found.light);
}

bool SpotJudge::is_faint_beam(const SpotFit& found) const noexcept {
  constexpr int kManyAreFaint = 4;  // one of so many with light
  return is_believed(found) && found.same_lit && 2 * found.spots >= lenslets_ &&
         kManyAreFaint * found.faint >= found.light;
}

/// Returns which part of the lenslet's neighbours has a well-formed spot.
float SpotJudge::kept_neighbours(int row, int col) const noexcept {
  int all = 0;
  int kept = 0;
  for (int r = std::max(row - 1, 0); r <= std::min(row + 1, spot_.rows() - 1); ++r) {
    for (int c = std::max(col - 1, 0); c <= std::min(col + 1, spot_.cols() - 1); ++c) {
      if (lenslet_(r, c) == 0 || (r == row && c == col)) continue;
      ++all;
      kept += is_sure(spot_(r, c)) ? 1 : 0;
    }
  }
  return all > 0 ? static_cast<float>(kept) / static_cast<float>(all) : 0.0F;
}

/// Returns whether judge() may have something to say of lenslets [first, last): a spot that is far
/// off, or one where there was none in the frames before.
bool SpotJudge::has_doubts(const Centroids& centroids, std::size_t first,
                           std::size_t last) const noexcept {
  const std::uint8_t* state = state_bytes(centroids);
  int doubts = 0;
  for (std::size_t k = first; k < last; ++k) {
    const int has = (state[k] == kValidByte) | (state[k] == kFaintByte) | (state[k] == kAtEdgeByte);
    doubts |= has & (static_cast<int>(spot_[k] == kFarOff) | static_cast<int>(seen_[k] <= 0));
  }
  return doubts != 0;
}

void SpotJudge::judge(Centroids& centroids, std::vector<std::uint8_t>& row_changed) const noexcept {
  constexpr float kAmongSpots = 0.75F;
  constexpr float kForDark = 0.5F;
  constexpr float kAlone = 0.25F;
  const std::size_t cols = as_size(spot_.cols());
  for (int r = 0; r < spot_.rows(); ++r) {
    const std::size_t first = as_size(r) * cols;
    if (!has_doubts(centroids, first, first + cols)) continue;
    for (int c = 0; c < spot_.cols(); ++c) {
      const std::size_t k = first + as_size(c);
      const LensletState state = centroids.state[k];
      if (state != LensletState::kValid && state != LensletState::kFaint &&
          state != LensletState::kAtEdge)
        continue;
      // Where a lenslet had its spot in one of the last frames, light fell before and may again.
      const float kept = seen_[k] > 0 ? 1.0F : kept_neighbours(r, c);
      const float needed = is_sure(spot_[k])        ? kAlone
                           : spot_[k] == kNearModel ? kAmongSpots
                                                    : kForDark;
      if (kept >= needed && spot_[k] != kFarOff) continue;
      row_changed[as_size(r)] = 1;
      kept < needed ? lose(centroids, k) : darken(centroids, k);
    }
  }
}

void SpotJudge::remember(const Centroids& centroids) noexcept {
  const std::uint8_t* __restrict state = state_bytes(centroids);
  std::int8_t* __restrict seen = seen_.data();
  // Before the first frame a lenslet counts as if it had always been as it is.
  const int step = started_ ? 1 : kSeenMax;
  if (!started_) seen_.fill(0);
  const std::size_t n = seen_.size();
  for (std::size_t k = 0; k < n; ++k) {
    const int now = seen[k] + (state[k] == kValidByte ? step : -step);
    seen[k] = static_cast<std::int8_t>(std::clamp(now, 0, +kSeenMax));
  }
  started_ = true;
  mark_lit();
}

void SpotJudge::mark_lit() noexcept {
  const std::int8_t* __restrict seen = seen_.data();
  std::uint8_t* __restrict lit = lit_.data();
  const std::size_t n = seen_.size();
  for (std::size_t k = 0; k < n; ++k) lit[k] = 2 * seen[k] > kSeenMax ? 1 : 0;
}

void SpotJudge::recall(bool started, const Image<std::int8_t>& seen) {
  started_ = started;
  seen_ = seen;
  if (started_)
    mark_lit();
  else
    lit_ = lenslet_;
}

void SpotJudge::lose_all(bool dark, Centroids& centroids) noexcept {
  for (std::size_t k = 0; k < centroids.state.size(); ++k) {
    if (has_light(centroids.state[k]))
      lose(centroids, k);
    else if (centroids.state[k] == LensletState::kFaint)
      dark ? darken(centroids, k) : lose(centroids, k);
  }
}

}  // namespace curlew
