#include "detect/vortex_tracker.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/error.h"

namespace curlew {
namespace {

constexpr std::size_t kCandidatesPerTrack = 4;
constexpr std::size_t kPairsPerTrack = 12;  // candidates a track chooses among
constexpr float kGate = 13.8F;              // of χ² with two degrees of freedom: .999
constexpr float kFarthest = 2.5F;           // pitches: no track is worth looking up farther
constexpr float kLeastScore = -3.0F;        // a track that has fallen so low is given up
constexpr float kLostPosition = 0.5F;       // pitches², variance: nor is one that may be anywhere
constexpr float kPairReach = 1.5F;       // pitches: opposite vortices nearer may be born together
constexpr float kPairRadius = 1.0F;      // pitches: an unresolved pair tells of tracks this near
constexpr float kSameVortex = 0.6F;      // pitches: tracks of one charge nearer are one
constexpr float kGoing = 2.0F;           // times a miss counts where a vortex may have gone
constexpr float kLikely = -1.0F;         // log odds: who may be a new vortex's partner
constexpr float kEdge = 1.0F;            // pitches: within it vortices come and go one by one
constexpr float kOutside = 0.5F;         // pitches beyond the outermost lenslet centres: gone
constexpr float kMostLogOdds = 5.0F;     // no detector is surer
constexpr float kMissedLogOdds = -4.5F;  // counts as evidence where nothing is seen
constexpr float kSureFrom = -0.1F;
constexpr float kSurerByScore = 0.14F;
constexpr float kSurerByMean = 0.9F;
constexpr float kLearning = 0.02F;      // a frame
constexpr float kFirstDensity = 0.02F;  // vortices of one charge a square pitch
constexpr float kFirstDetection = 0.9F;
constexpr int kLeastForDrift = 3;  // tracks
constexpr int kAgeForDrift = 5;    // frames

template <typename T>
T square(T x) noexcept {
  return x * x;
}

float log_odds(float probability) noexcept {
  const float p = std::clamp(probability, 1e-3F, 1.0F - 1e-3F);
  return std::clamp(std::log(p / (1.0F - p)), -kMostLogOdds, kMostLogOdds);
}

float odds_to_probability(float log_odds) noexcept { return 1.0F / (1.0F + std::exp(-log_odds)); }

/// ln(1 + e^x).
float softplus(float x) noexcept { return x > 15.0F ? x : std::log1p(std::exp(x)); }

/// Of a detector that states no probability: noise leaves |D|/σ half normal in a cell, vortices
/// spread it evenly up to 20.
float log_odds_of_significance(float significance, float density) noexcept {
  const float noise = 2.0F * std::numbers::inv_sqrtpi_v<float> / std::numbers::sqrt2_v<float>;
  const float z = std::min(significance, 8.0F);
  const float odds = std::log(density / 20.0F / noise) + 0.5F * z * z;
  return std::clamp(odds, -kMostLogOdds, kMostLogOdds);
}

const TrackerOptions& checked(const TrackerOptions& o) {
  const auto part = [](double x) { return x > 0.0 && x <= 1.0; };
  const auto positive = [](double x) { return std::isfinite(x) && x > 0.0; };
  if (!positive(o.false_tracks_per_frame))
    throw UsageError("false tracks a frame must be a number above 0, such as 0.001");
  if (!part(o.min_probability) || !part(o.min_probability_single))
    throw UsageError("a track's least probability must be above 0 and at most 1");
  if (!part(o.evidence_weight) || !part(o.memory) || !part(o.lone_birth))
    throw UsageError("a tracker's weights must be above 0 and at most 1");
  if (!(o.max_score >= 2.0) || !(o.lasting_error >= 0.0) || !(o.average_frames >= 1.0) ||
      !positive(o.unknown_error) || !positive(o.own_velocity) || !positive(o.own_velocity_frames) ||
      !positive(o.wander) || !positive(o.max_drift) || !positive(o.longest_gap_frames))
    throw UsageError(
        "a tracker's errors, speeds and times must be above 0, its largest score 2 or more");
  return o;
}

template <typename A, typename B>
bool is_near(const A& a, const B& b, float reach) noexcept {
  return square(a.x() - b.x()) + square(a.y() - b.y()) < reach * reach;
}

Eigen::Vector2f place(const Vortex& vortex) noexcept { return {vortex.x, vortex.y}; }

}  // namespace

VortexTracker::VortexTracker(const TrackerOptions& options, int lenslet_rows, int lenslet_cols,
                             std::size_t capacity)
    : options_(checked(options)),
      rows_(static_cast<float>(lenslet_rows)),
      cols_(static_cast<float>(lenslet_cols)),
      tracks_(capacity),
      observations_(kCandidatesPerTrack * capacity),
      rows_of_charge_(capacity),
      cols_of_charge_(observations_.size()),
      likely_(observations_.size()),
      sorted_(capacity),
      pairs_(observations_.size()),
      assignment_(capacity, observations_.size(), kPairsPerTrack) {
  reset();
}

void VortexTracker::reset() noexcept {
  n_tracks_ = 0;
  n_observations_ = 0;
  n_pairs_ = 0;
  frames_ = 0;
  interval_s_ = 0.0F;
  drift_.setZero();
  drift_known_ = 0.0F;
  density_ = kFirstDensity;
  detection_ = kFirstDetection;
  births_ = 1.0F;
}

void VortexTracker::update(double time_s, VortexList& vortices) noexcept {
  if (!advance(time_s)) {
    reset();
    time_s_ = time_s;
  }
  observe(vortices);
  weigh_births(vortices);
  assign(vortices, 1);
  assign(vortices, -1);
  for (std::size_t i = 0; i < n_tracks_; ++i) {
    Track& track = tracks_[i];
    ++track.age;
    if (track.seen >= 0) {
      const auto seen = static_cast<std::size_t>(track.seen);
      follow(track, vortices[seen], observations_[seen]);
    } else {
      miss(track);
    }
  }
  learn();
  begin_tracks(vortices);
  settle();
  learn_drift();
  ++frames_;
  report(vortices);
}

/// Moves all tracks to time_s; false where that cannot be.
bool VortexTracker::advance(double time_s) noexcept {
  if (frames_ == 0) {
    time_s_ = time_s;
    return true;
  }
  const auto dt = static_cast<float>(time_s - time_s_);
  if (dt == 0.0F && interval_s_ > 0.0F) {  // a clock too coarse for the frames
    predict(interval_s_);
    return true;
  }
  if (!(dt > 0.0F)) return false;
  if (interval_s_ == 0.0F) {
    interval_s_ = dt;
    const float unknown = square(static_cast<float>(options_.max_drift) / interval_s_);
    for (std::size_t i = 0; i < n_tracks_; ++i)
      tracks_[i].covariance.bottomRightCorner<2, 2>() = unknown * Eigen::Matrix2f::Identity();
  }
  if (dt > static_cast<float>(options_.longest_gap_frames) * interval_s_) return false;
  interval_s_ += 0.05F * (std::clamp(dt, 0.5F * interval_s_, 2.0F * interval_s_) - interval_s_);
  time_s_ = time_s;
  predict(dt);
  return true;
}

// A velocity of its own dies away, and is renewed so that its variance lasts.
void VortexTracker::predict(float dt) noexcept {
  const float frames = dt / interval_s_;
  const float stays =
      drift_known_ * std::exp(-frames / static_cast<float>(options_.own_velocity_frames)) +
      (1.0F - drift_known_);
  const float renewed =
      square(static_cast<float>(options_.own_velocity) / interval_s_) *
      (1.0F - std::exp(-2.0F * frames / static_cast<float>(options_.own_velocity_frames)));
  const float wander = square(static_cast<float>(options_.wander)) * frames;
  std::size_t kept = 0;
  for (std::size_t i = 0; i < n_tracks_; ++i) {
    Track& track = tracks_[i];
    track.state.head<2>() += dt * track.state.tail<2>();
    track.state.tail<2>() = stays * track.state.tail<2>() + (1.0F - stays) * drift_;
    const Eigen::Matrix2f cross = track.covariance.topRightCorner<2, 2>();
    const Eigen::Matrix2f velocity = track.covariance.bottomRightCorner<2, 2>();
    track.covariance.topLeftCorner<2, 2>() += dt * (cross + cross.transpose()) +
                                              square(dt) * velocity +
                                              wander * Eigen::Matrix2f::Identity();
    track.covariance.topRightCorner<2, 2>() = stays * (cross + dt * velocity);
    track.covariance.bottomLeftCorner<2, 2>() = track.covariance.topRightCorner<2, 2>().transpose();
    track.covariance.bottomRightCorner<2, 2>() =
        square(stays) * velocity + renewed * Eigen::Matrix2f::Identity();
    if (distance_to_edge(track.state.x(), track.state.y()) < -kOutside) continue;
    if (kept != i) tracks_[kept] = track;
    ++kept;
  }
  n_tracks_ = kept;
}

/// How far inside the outermost lenslet centres.
float VortexTracker::distance_to_edge(float x, float y) const noexcept {
  return std::min(std::min(x, cols_ - 1.0F - x), std::min(y, rows_ - 1.0F - y));
}

void VortexTracker::observe(const VortexList& candidates) noexcept {
  n_observations_ = std::min(candidates.size(), observations_.size());
  overflow_ += static_cast<std::int64_t>(candidates.size() - n_observations_);
  n_pairs_ = 0;
  const float unknown = square(static_cast<float>(options_.unknown_error));
  for (std::size_t i = 0; i < n_observations_; ++i) {
    const Vortex& candidate = candidates[i];
    Observation& observation = observations_[i];
    observation.track = -1;
    observation.log_odds = candidate.probability >= 0.0F
                               ? log_odds(candidate.probability)
                               : log_odds_of_significance(candidate.significance, density_);
    if (candidate.variance_x > 0.0F && candidate.variance_y > 0.0F) {
      observation.covariance << candidate.variance_x, candidate.covariance_xy,
          candidate.covariance_xy, candidate.variance_y;
    } else {
      observation.covariance = unknown * Eigen::Matrix2f::Identity();
    }
    if (candidate.charge == 0) pairs_[n_pairs_++] = candidate;
  }
}

/// Vortices are born in opposite pairs or come over the edge; one alone in the middle has been
/// overlooked before.
void VortexTracker::weigh_births(const VortexList& candidates) noexcept {
  const auto lone = static_cast<float>(std::log(options_.lone_birth));
  std::size_t n_likely = 0;
  for (std::size_t j = 0; j < n_observations_; ++j)
    if (observations_[j].log_odds > kLikely) likely_[n_likely++] = static_cast<std::int32_t>(j);
  for (std::size_t i = 0; i < n_observations_; ++i) {
    const Vortex& candidate = candidates[i];
    bool expected = frames_ == 0 || distance_to_edge(candidate.x, candidate.y) < kEdge;
    for (std::size_t k = 0; k < n_likely && !expected; ++k) {
      const Vortex& other = candidates[static_cast<std::size_t>(likely_[k])];
      expected =
          other.charge == -candidate.charge && is_near(place(candidate), place(other), kPairReach);
    }
    observations_[i].birth_log_odds = observations_[i].log_odds + (expected ? 0.0F : lone);
  }
}

void VortexTracker::assign(const VortexList& candidates, std::int32_t charge) noexcept {
  std::size_t rows = 0;
  std::size_t cols = 0;
  for (std::size_t i = 0; i < n_tracks_; ++i)
    if (tracks_[i].charge == charge) rows_of_charge_[rows++] = static_cast<std::int32_t>(i);
  for (std::size_t j = 0; j < n_observations_; ++j)
    if (candidates[j].charge == charge) cols_of_charge_[cols++] = static_cast<std::int32_t>(j);
  assignment_.clear(rows, cols);
  for (std::size_t row = 0; row < rows; ++row) {
    const Track& track = tracks_[static_cast<std::size_t>(rows_of_charge_[row])];
    const float exists = odds_to_probability(track.score);
    const float missed = std::log1p(-exists * detection_);
    for (std::size_t col = 0; col < cols; ++col) {
      const auto j = static_cast<std::size_t>(cols_of_charge_[col]);
      const Eigen::Vector2f off = place(candidates[j]) - track.state.head<2>();
      if (off.squaredNorm() > square(kFarthest)) continue;
      const Eigen::Matrix2f spread =
          track.covariance.topLeftCorner<2, 2>() + observations_[j].covariance;
      const float determinant = spread.determinant();
      const float mahalanobis = off.dot(spread.inverse() * off);
      if (mahalanobis > kGate) continue;
      const float ratio =
          observations_[j].log_odds - 0.5F * mahalanobis -
          std::log(2.0F * std::numbers::pi_v<float> * std::sqrt(determinant) * density_);
      const float seen = std::log1p(exists * (std::exp(std::min(ratio, 30.0F)) - 1.0F));
      assignment_.allow(row, col, seen - missed - softplus(observations_[j].birth_log_odds));
    }
  }
  assignment_.solve();
  for (std::size_t row = 0; row < rows; ++row) {
    const std::int32_t col = assignment_.col_of_row()[row];
    const std::int32_t i = rows_of_charge_[row];
    Track& track = tracks_[static_cast<std::size_t>(i)];
    track.seen = col < 0 ? -1 : cols_of_charge_[static_cast<std::size_t>(col)];
    if (track.seen >= 0) observations_[static_cast<std::size_t>(track.seen)].track = i;
  }
}

void VortexTracker::follow(Track& track, const Vortex& candidate,
                           const Observation& observation) noexcept {
  const Eigen::Vector2f off = place(candidate) - track.state.head<2>();
  const Eigen::Matrix2f spread = track.covariance.topLeftCorner<2, 2>() + observation.covariance;
  const Eigen::Matrix2f inverse = spread.inverse();
  const float evidence =
      observation.log_odds - 0.5F * off.dot(inverse * off) -
      std::log(2.0F * std::numbers::pi_v<float> * std::sqrt(spread.determinant()) * density_);
  if (track.score > 0.0F) track.score *= static_cast<float>(options_.memory);
  track.score = std::min(track.score + static_cast<float>(options_.evidence_weight) * evidence,
                         static_cast<float>(options_.max_score));
  average(track, observation.log_odds);
  const Eigen::Matrix<float, 4, 2> gain = track.covariance.leftCols<2>() * inverse;
  track.state += gain * off;
  track.covariance -= (gain * track.covariance.topRows<2>()).eval();
  track.covariance = (0.5F * (track.covariance + track.covariance.transpose())).eval();
  track.last = candidate;
}

/// A vortex that can go, over the edge or with an opposite one, is sooner believed gone.
void VortexTracker::miss(Track& track) noexcept {
  for (std::size_t i = 0; i < n_pairs_; ++i) {
    const float probability = pairs_[i].probability;
    const bool believed = probability == kUnknownProbability || probability >= 0.5F;
    if (believed && is_near(place(pairs_[i]), track.state, kPairRadius)) return;
  }
  bool may_go = distance_to_edge(track.state.x(), track.state.y()) < kOutside;
  for (std::size_t i = 0; i < n_tracks_ && !may_go; ++i)
    may_go =
        tracks_[i].charge == -track.charge && is_near(tracks_[i].state, track.state, kPairRadius);
  const float weight = may_go ? kGoing : 1.0F;
  if (track.score > 0.0F) track.score *= static_cast<float>(options_.memory);
  track.score += weight * static_cast<float>(options_.evidence_weight) * std::log1p(-detection_);
  average(track, kMissedLogOdds);
}

/// From each candidate that no track takes, unless a track of its charge is there already.
void VortexTracker::begin_tracks(const VortexList& candidates) noexcept {
  float begun = 0.0F;
  const std::size_t n_before = n_tracks_;
  for (std::size_t j = 0; j < n_observations_; ++j) {
    const Vortex& candidate = candidates[j];
    const Observation& observation = observations_[j];
    if (observation.track >= 0 || candidate.charge == 0) continue;
    bool there = false;
    for (std::size_t i = 0; i < n_before && !there; ++i)
      there = tracks_[i].charge == candidate.charge &&
              is_near(tracks_[i].state, place(candidate), kSameVortex);
    if (there) continue;
    begun += 1.0F;
    if (n_tracks_ == tracks_.size()) {
      ++overflow_;
      continue;
    }
    Track& track = tracks_[n_tracks_++];
    track = Track{};
    track.charge = candidate.charge;
    track.last = candidate;
    track.state << candidate.x, candidate.y, drift_.x(), drift_.y();
    track.covariance.setZero();
    track.covariance.topLeftCorner<2, 2>() = observation.covariance;
    const float own = square(static_cast<float>(options_.own_velocity));
    const float unknown = square(static_cast<float>(options_.max_drift));
    const float velocity = own + (1.0F - drift_known_) * unknown;
    // Before the second frame nobody knows how long a frame is; see advance().
    track.covariance(2, 2) = track.covariance(3, 3) =
        interval_s_ > 0.0F ? velocity / square(interval_s_) : 0.0F;
    track.score = static_cast<float>(options_.evidence_weight) * observation.birth_log_odds;
    track.evidence = observation.log_odds;
    track.seen = static_cast<std::int32_t>(j);
    track.age = 1;
  }
  if (frames_ > 0) births_ += kLearning * (begun - births_);
}

/// Confirms tracks and gives others up.
void VortexTracker::settle() noexcept {
  // Of `births_` clutter tracks a frame, the part e^−threshold ever comes so far.
  const float threshold = std::clamp(
      std::log(std::max(births_, 0.1F) / static_cast<float>(options_.false_tracks_per_frame)), 1.0F,
      static_cast<float>(options_.max_score) - 0.5F);
  std::size_t kept = 0;
  for (std::size_t i = 0; i < n_tracks_; ++i) {
    Track& track = tracks_[i];
    bool lost = track.score < kLeastScore || track.covariance(0, 0) > kLostPosition ||
                track.covariance(1, 1) > kLostPosition;
    for (std::size_t j = 0; track.seen < 0 && j < kept && !lost; ++j)
      lost =
          tracks_[j].charge == track.charge && is_near(tracks_[j].state, track.state, kSameVortex);
    if (lost) continue;
    if (track.id < 0 && track.score >= threshold) track.id = next_id_++;
    if (kept != i) tracks_[kept] = track;
    ++kept;
  }
  n_tracks_ = kept;
}

/// Density and probability of detection.
void VortexTracker::learn() noexcept {
  float vortices = 0.0F;
  for (std::size_t j = 0; j < n_observations_; ++j)
    vortices += odds_to_probability(observations_[j].log_odds);
  const float area = std::max(1.0F, (rows_ - 1.0F) * (cols_ - 1.0F));
  density_ = std::clamp(density_ + kLearning * (0.5F * vortices / area - density_), 0.002F, 0.2F);
  float confirmed = 0.0F;
  float seen = 0.0F;
  for (std::size_t i = 0; i < n_tracks_; ++i) {
    if (tracks_[i].id < 0) continue;
    confirmed += 1.0F;
    seen += tracks_[i].seen >= 0 ? 1.0F : 0.0F;
  }
  if (confirmed > 0.0F) {
    detection_ = std::clamp(detection_ + kLearning * (seen / confirmed - detection_), 0.5F, 0.98F);
  }
}

/// The median of the confirmed tracks' velocities, smoothed.
void VortexTracker::learn_drift() noexcept {
  Eigen::Vector2f median;
  std::size_t n = 0;
  for (int axis = 0; axis < 2; ++axis) {
    n = 0;
    for (std::size_t i = 0; i < n_tracks_; ++i)
      if (tracks_[i].id >= 0 && tracks_[i].age >= kAgeForDrift)
        sorted_[n++] = tracks_[i].state(axis + 2);
    if (n < kLeastForDrift) return;
    std::sort(sorted_.begin(), sorted_.begin() + static_cast<std::ptrdiff_t>(n));
    median(axis) = 0.5F * (sorted_[(n - 1) / 2] + sorted_[n / 2]);
  }
  // Fast at first, then an average over some 20 frames.
  const float gain = std::max(0.05F, 1.0F - drift_known_);
  drift_ += gain * (median - drift_);
  drift_known_ += 0.1F * (1.0F - drift_known_);
}

/// What detectors make of a track, over its last frames.
void VortexTracker::average(Track& track, float seen) const noexcept {
  const float part = std::max(static_cast<float>(1.0 / options_.average_frames),
                              1.0F / static_cast<float>(track.age));
  track.evidence += part * (seen - track.evidence);
}

/// That the track is a vortex now: a logistic regression of simulated tracks, Rytov variance 2,
/// 1000 and 200 photons. A score is too sure, for its evidence is not independent.
float VortexTracker::probability(const Track& track) noexcept {
  return odds_to_probability(kSureFrom + kSurerByScore * track.score +
                             kSurerByMean * track.evidence);
}

void VortexTracker::report(VortexList& vortices) noexcept {
  const float lasting = square(static_cast<float>(options_.lasting_error));
  vortices.shorten(0);  // clear() would forget what the detector had no room for
  for (std::size_t i = 0; i < n_tracks_; ++i) {
    const Track& track = tracks_[i];
    const float sure = probability(track);
    const double least = track.id >= 0 ? options_.min_probability : options_.min_probability_single;
    if (static_cast<double>(sure) < least) continue;
    Vortex vortex = track.last;
    vortex.x = std::clamp(track.state(0), 0.0F, cols_ - 1.0F);
    vortex.y = std::clamp(track.state(1), 0.0F, rows_ - 1.0F);
    vortex.probability = sure;
    vortex.variance_x = track.covariance(0, 0) + lasting;
    vortex.variance_y = track.covariance(1, 1) + lasting;
    vortex.covariance_xy = track.covariance(0, 1);
    vortex.velocity_x = track.state(2);
    vortex.velocity_y = track.state(3);
    vortex.track = track.id;
    if (track.seen < 0) vortex.flags |= kVortexPredicted;
    vortices.push(vortex);
  }
  for (std::size_t k = 0; k < n_pairs_; ++k) {
    if (pairs_[k].probability >= 0.0F &&
        static_cast<double>(pairs_[k].probability) < options_.min_probability)
      continue;
    bool positive = false;
    bool negative = false;
    for (std::size_t i = 0; i < n_tracks_; ++i) {
      if (tracks_[i].id < 0 || !is_near(place(pairs_[k]), tracks_[i].state, kPairRadius)) continue;
      positive |= tracks_[i].charge > 0;
      negative |= tracks_[i].charge < 0;
    }
    if (!(positive && negative)) vortices.push(pairs_[k]);
  }
}

}  // namespace curlew
