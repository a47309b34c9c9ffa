// This file declares tracking: which vortices of two frames are the same, how vortices move, and
// which of them are real.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/assignment.h"
#include "core/vortex.h"
#include "detect/tracking/tracker_options.h"
#include "detect/tracking/vortex_motion.h"

namespace curlew {

/// Follows the vortices of successive frames. A track takes at most one candidate a frame, of its
/// own charge.
///
/// A track's score is the logarithm of the odds that it is a vortex. A candidate of probability p
/// at z adds ln[p/(1 − p) · N(z)/ρ], where N is the density predicted by the track's Kalman filter
/// and ρ the density of vortices. A miss adds ln(1 − P_D). This is the sequential test of D. B.
/// Reid, IEEE Trans. Autom. Control 24, 843 (1979), and S. Blackman and R. Popoli, Design and
/// Analysis of Modern Tracking Systems (1999). Candidates far too unlikely to be reported alone
/// thus make a vortex when they follow one another. A track is confirmed, and gets its number, when
/// clutter would come so far only as often as false_tracks_per_frame says: by Ville's inequality
/// e^−score bounds that probability. ρ, P_D and the drift common to all are learnt from what is
/// seen.
class VortexTracker {
 public:
  /// Tracks over [lenslet_rows, lenslet_cols] lenslets, at most `capacity` tracks at once,
  /// tentative ones included. Throws UsageError where an option is out of its range.
  VortexTracker(const TrackerOptions& options, int lenslet_rows, int lenslet_cols,
                std::size_t capacity);

  /// Replaces a detector's candidates by what is tracked. On entry `vortices` holds the candidates,
  /// however unlikely; at most 4·capacity of them count. On return it holds the vortices of
  /// confirmed tracks, older ones first, and what min_probability_single lets pass. Their position
  /// and its covariance are filtered, they have a velocity, and their probability is that by all
  /// frames so far. A track that was not seen in this frame is flagged kVortexPredicted. Unresolved
  /// pairs (charge 0) pass unless confirmed tracks of both charges lie there; they keep tracks
  /// alive. A step back in time, or a long gap, begins anew. The list's overflow keeps what it
  /// counted, and what does not fit now is added.
  void update(double time_s, VortexList& vortices) noexcept;
  /// Forgets everything but the numbers already given, which are never given again.
  void reset() noexcept;
  /// Sets the number of the next track that is confirmed; it is 0 by default. It must not be below
  /// numbers already given.
  void number_from(std::int64_t first) noexcept { next_id_ = first; }

  /// Returns how many candidates ever found no room for a track.
  std::int64_t overflow() const { return overflow_; }
  /// Returns the drift common to all, in pitches a second, and 0 while it is not known.
  std::array<float, 2> drift() const { return {motion_.drift().x(), motion_.drift().y()}; }

 private:
  struct Track {
    MotionState state;
    Vortex last;           // last candidate
    std::int64_t id = -1;  // −1 if not confirmed
    float score = 0;       // ln of the odds
    float evidence = 0;    // mean log odds of the candidates
    std::int32_t age = 0;  // in frames
    std::int32_t charge = 0;
    std::int32_t seen = -1;  // candidate of this frame, or −1
  };
  struct Observation {
    float log_odds = 0;
    float birth_log_odds = 0;  // log odds of a vortex that no track has yet
    Eigen::Matrix2f covariance = Eigen::Matrix2f::Zero();
    std::int32_t track = -1;
  };

  bool advance(double time_s) noexcept;
  void predict(float dt) noexcept;
  void observe(const VortexList& candidates) noexcept;
  void weigh_births(const VortexList& candidates) noexcept;
  void assign(const VortexList& candidates, std::int32_t charge) noexcept;
  float evidence(const Observation& observation, const Innovation& innovation) const noexcept;
  void follow(Track& track, const Vortex& candidate, const Observation& observation) noexcept;
  void miss(Track& track) noexcept;
  void begin_tracks(const VortexList& candidates) noexcept;
  void settle() noexcept;
  void learn() noexcept;
  void learn_drift() noexcept;
  void report(VortexList& vortices) noexcept;
  void average(Track& track, float seen) const noexcept;
  static float probability(const Track& track) noexcept;
  float distance_to_edge(float x, float y) const noexcept;

  TrackerOptions options_;
  float rows_;
  float cols_;
  std::vector<Track> tracks_;  // [capacity], the first n_tracks_ alive, older ones first
  std::size_t n_tracks_ = 0;
  std::vector<Observation> observations_;  // [4·capacity]
  std::size_t n_observations_ = 0;
  std::vector<std::int32_t> rows_of_charge_;  // tracks of the charge being assigned
  std::vector<std::int32_t> cols_of_charge_;
  std::vector<std::int32_t> likely_;  // observations that may be a partner
  std::vector<float> velocity_x_;     // velocities of the tracks that tell the drift
  std::vector<float> velocity_y_;
  std::vector<Vortex> pairs_;  // candidates of charge 0 in this frame
  std::size_t n_pairs_ = 0;
  Assignment assignment_;
  VortexMotion motion_;

  std::int64_t next_id_ = 0;
  std::int64_t overflow_ = 0;
  double time_s_ = 0;
  int frames_ = 0;       // number of frames since the last reset
  float density_ = 0;    // vortices of one charge a square pitch
  float detection_ = 0;  // P_D
  float births_ = 0;     // candidates a frame that begin tracks
};

}  // namespace curlew
