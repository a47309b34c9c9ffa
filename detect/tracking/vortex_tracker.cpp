#include "detect/tracking/vortex_tracker.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace curlew {
namespace {

constexpr std::size_t kCandidatesPerTrack = 4;
constexpr std::size_t kPairsPerTrack = 12;  // candidates among which a track chooses
constexpr float kGate = 13.8F;              // .999 of χ² with two degrees of freedom
constexpr float kFarthest = 2.5F;           // pitches; a track looks no farther for candidates
constexpr float kMinScore = -3.0F;          // A track is given up below this score.
constexpr float kLostPosition = 0.5F;       // pitches²; a track with more variance is given up
constexpr float kPairReach = 1.5F;   // pitches; opposite vortices within it may be born together
constexpr float kPairRadius = 1.0F;  // pitches; an unresolved pair stands for tracks within it
constexpr float kSameVortex = 0.6F;  // pitches; tracks of one charge within it are one
constexpr float kGoing = 2.0F;       // factor on a miss where a vortex may have gone
constexpr float kLikely = -1.0F;     // log odds; from here on, a candidate may be a partner
constexpr float kEdge = 1.0F;        // pitches; this near the edge vortices come and go singly
constexpr float kOutside = 0.5F;     // pitches; a track is gone this far outside
constexpr float kMaxLogOdds = 5.0F;  // No detector is surer than this.
constexpr float kMissedLogOdds = -4.5F;  // log odds counted where nothing is seen
constexpr float kSureFrom = -0.1F;
constexpr float kSurerByScore = 0.14F;
constexpr float kSurerByMean = 0.9F;
constexpr float kLearning = 0.02F;      // part learnt in a frame
constexpr float kFirstDensity = 0.02F;  // vortices of one charge a square pitch
constexpr float kFirstDetection = 0.9F;
constexpr std::size_t kMinForDrift = 3;  // in tracks
constexpr int kAgeForDrift = 5;          // in frames

template <typename T>
T square(T x) noexcept {
  return x * x;
}

float log_odds(float probability) noexcept {
  const float p = std::clamp(probability, 1e-3F, 1.0F - 1e-3F);
  return std::clamp(std::log(p / (1.0F - p)), -kMaxLogOdds, kMaxLogOdds);
}

float odds_to_probability(float log_odds) noexcept { return 1.0F / (1.0F + std::exp(-log_odds)); }

/// Returns ln(1 + e^x).
float softplus(float x) noexcept { return x > 15.0F ? x : std::log1p(std::exp(x)); }

/// Returns the log odds for a detector that states no probability. In a cell with noise alone |D|/σ
/// is half normal; vortices spread it evenly up to 20.
float log_odds_of_significance(float significance, float density) noexcept {
  const float noise = 2.0F * std::numbers::inv_sqrtpi_v<float> / std::numbers::sqrt2_v<float>;
  const float z = std::min(significance, 8.0F);
  const float odds = std::log(density / 20.0F / noise) + 0.5F * z * z;
  return std::clamp(odds, -kMaxLogOdds, kMaxLogOdds);
}

const TrackerOptions& checked(const TrackerOptions& options) {
  check_tracker_options(options);
  return options;
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
      velocity_x_(capacity),
      velocity_y_(capacity),
      pairs_(observations_.size()),
      assignment_(capacity, observations_.size(), kPairsPerTrack),
      motion_(options) {
  reset();
}

void VortexTracker::reset() noexcept {
  n_tracks_ = 0;
  n_observations_ = 0;
  n_pairs_ = 0;
  frames_ = 0;
  motion_.reset();
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

/// Moves all tracks to time_s. Returns false where this is not possible.
bool VortexTracker::advance(double time_s) noexcept {
  if (frames_ == 0) {
    time_s_ = time_s;
    return true;
  }
  const auto dt = static_cast<float>(time_s - time_s_);
  if (dt == 0.0F && motion_.interval_s() > 0.0F) {  // The clock is too coarse for the frames.
    predict(motion_.interval_s());
    return true;
  }
  if (!(dt > 0.0F)) return false;
  if (motion_.interval_s() == 0.0F) {
    motion_.learn_interval(dt);
    for (std::size_t i = 0; i < n_tracks_; ++i) motion_.doubt_velocity(tracks_[i].state);
  }
  if (dt > static_cast<float>(options_.longest_gap_frames) * motion_.interval_s()) return false;
  motion_.learn_interval(dt);
  time_s_ = time_s;
  predict(dt);
  return true;
}

void VortexTracker::predict(float dt) noexcept {
  const MotionStep step = motion_.step(dt);
  std::size_t kept = 0;
  for (std::size_t i = 0; i < n_tracks_; ++i) {
    Track& track = tracks_[i];
    track.state.predict(step);
    if (distance_to_edge(track.state.x(), track.state.y()) < -kOutside) continue;
    if (kept != i) tracks_[kept] = track;
    ++kept;
  }
  n_tracks_ = kept;
}

/// Returns how far (x, y) lies inside the outermost lenslet centres.
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

/// Sets the log odds that a candidate is a new vortex. Vortices are born in opposite pairs or come
/// over the edge. A lone one in the middle must have been overlooked before, which is less likely.
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
      const Eigen::Vector2f position = place(candidates[j]);
      if ((position - track.state.mean.head<2>()).squaredNorm() > square(kFarthest)) continue;
      const Innovation innovation = track.state.innovation(position, observations_[j].covariance);
      if (innovation.mahalanobis2 > kGate) continue;
      const float ratio = evidence(observations_[j], innovation);
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

/// Returns ln[p/(1 − p) · N(z)/ρ].
float VortexTracker::evidence(const Observation& observation,
                              const Innovation& innovation) const noexcept {
  return observation.log_odds - 0.5F * innovation.mahalanobis2 -
         std::log(2.0F * std::numbers::pi_v<float> * std::sqrt(innovation.determinant) * density_);
}

void VortexTracker::follow(Track& track, const Vortex& candidate,
                           const Observation& observation) noexcept {
  const Innovation innovation = track.state.innovation(place(candidate), observation.covariance);
  if (track.score > 0.0F) track.score *= static_cast<float>(options_.memory);
  track.score = std::min(track.score + static_cast<float>(options_.evidence_weight) *
                                           evidence(observation, innovation),
                         static_cast<float>(options_.max_score));
  average(track, observation.log_odds);
  track.state.update(innovation);
  track.last = candidate;
}

/// Counts a miss. A vortex that can go, over the edge or with an opposite one, is believed gone
/// sooner. An unresolved pair there counts as neither seen nor missed.
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

/// Begins a track from each candidate that no track takes, unless a track of its charge is already
/// there.
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
    track.state = motion_.begin(place(candidate), observation.covariance);
    track.score = static_cast<float>(options_.evidence_weight) * observation.birth_log_odds;
    track.evidence = observation.log_odds;
    track.seen = static_cast<std::int32_t>(j);
    track.age = 1;
  }
  if (frames_ > 0) births_ += kLearning * (begun - births_);
}

/// Confirms tracks and gives others up.
void VortexTracker::settle() noexcept {
  // Of `births_` clutter tracks a frame, only the part e^−threshold ever comes so far.
  const float threshold = std::clamp(
      std::log(std::max(births_, 0.1F) / static_cast<float>(options_.false_tracks_per_frame)), 1.0F,
      static_cast<float>(options_.max_score) - 0.5F);
  std::size_t kept = 0;
  for (std::size_t i = 0; i < n_tracks_; ++i) {
    Track& track = tracks_[i];
    bool lost = track.score < kMinScore || track.state.covariance(0, 0) > kLostPosition ||
                track.state.covariance(1, 1) > kLostPosition;
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

/// Learns the density and the probability of detection.
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

/// Learns the drift from the confirmed tracks.
void VortexTracker::learn_drift() noexcept {
  std::size_t n = 0;
  for (std::size_t i = 0; i < n_tracks_; ++i) {
    if (tracks_[i].id < 0 || tracks_[i].age < kAgeForDrift) continue;
    velocity_x_[n] = tracks_[i].state.mean(2);
    velocity_y_[n++] = tracks_[i].state.mean(3);
  }
  if (n >= kMinForDrift) motion_.learn_drift({velocity_x_.data(), n}, {velocity_y_.data(), n});
}

/// Averages what the detector says of a track over its last frames.
void VortexTracker::average(Track& track, float seen) const noexcept {
  const float part = std::max(static_cast<float>(1.0 / options_.average_frames),
                              1.0F / static_cast<float>(track.age));
  track.evidence += part * (seen - track.evidence);
}

/// Returns the probability that the track is a vortex now. It is a logistic regression on simulated
/// tracks with a Rytov variance of 2 and 1000 and 200 photons. The score alone would be too sure,
/// because its evidence is not independent.
float VortexTracker::probability(const Track& track) noexcept {
  return odds_to_probability(kSureFrom + kSurerByScore * track.score +
                             kSurerByMean * track.evidence);
}

void VortexTracker::report(VortexList& vortices) noexcept {
  const float lasting = square(static_cast<float>(options_.lasting_error));
  // clear() would forget how many vortices the detector had no room for.
  vortices.shorten(0);
  for (std::size_t i = 0; i < n_tracks_; ++i) {
    const Track& track = tracks_[i];
    const float sure = probability(track);
    const double minimum =
        track.id >= 0 ? options_.min_probability : options_.min_probability_single;
    if (static_cast<double>(sure) < minimum) continue;
    Vortex vortex = track.last;
    vortex.x = std::clamp(track.state.mean(0), 0.0F, cols_ - 1.0F);
    vortex.y = std::clamp(track.state.mean(1), 0.0F, rows_ - 1.0F);
    vortex.probability = sure;
    vortex.variance_x = track.state.covariance(0, 0) + lasting;
    vortex.variance_y = track.state.covariance(1, 1) + lasting;
    vortex.covariance_xy = track.state.covariance(0, 1);
    vortex.velocity_x = track.state.mean(2);
    vortex.velocity_y = track.state.mean(3);
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
