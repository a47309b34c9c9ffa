// This file declares the interpretable detector, `whitened`: a matched filter on circulation,
// whitened by each lenslet's noise.
#pragma once

#include <cstddef>
#include <cstdint>

#include "core/fixed_list.h"
#include "core/image.h"
#include "core/slope_field.h"
#include "core/vortex.h"
#include "detect/circulation_finder.h"
#include "detect/whitened/whitened_filter.h"

namespace curlew {

/// The numbers without a unit in their name were fitted to simulated turbulence, on other fields
/// than the benchmark's test fields.
struct WhitenedOptions {
  /// This is the mean number of vortices a frame, at most, where there is only slope noise, before
  /// those with too low a probability are left out. It must be more than 0.
  double false_alarms_per_frame = 0.01;
  double min_probability = 0.5;  ///< less likely vortices are not reported; in (0, 1)

  /// The pattern is what D looks like round a vortex. The clutter says how far slopes differ from
  /// that: it is the variance of a slope near a vortex which other vortices and the bent phase
  /// cause. It keeps a bright lenslet from deciding alone. It must be more than 0.
  VortexPattern pattern{};
  double slope_clutter_rad2 = 0.7;

  // ln of the odds = offset + per_sigma·z + per_darkness·darkness
  //                   + per_log_information·ln(clutter·information) + per_log_noise·ln(noise)
  double log_odds = -10.765;
  double log_odds_per_sigma = 4.0;
  double log_odds_per_darkness = 1.875;
  double log_odds_per_log_information = -1.17;
  double log_odds_per_log_noise = -0.82;

  /// The position starts at the node and goes this fraction of the way to the centroid of D.
  double circulation_pull = 0.605;
  /// It then goes this many pitches per unit of brightness (a factor e in flux) towards the darker
  /// side.
  double darkness_pull = 0.158;
  double position_variance = 0.045;         ///< along an axis, pitches², for a vortex with z = ∞
  double position_variance_per_z2 = 0.114;  ///< added to that, over z²

  /// Two opposite vortices of nearly the same strength are one unresolved pair if they are nearer
  /// than this many standard deviations of their separation and nearer than 1¼ pitches. 0 makes no
  /// pairs.
  double pair_sigmas = 3.0;
  /// This is a probability. A vortex above it makes no pair with one below it.
  double pair_likely = 0.5;

  bool operator==(const WhitenedOptions&) const = default;
};

/// The plan holds all that follows from the options and the pupil. It is const after construction
/// and shared by threads.
class WhitenedPlan {
 public:
  /// `lenslet_valid` is [rows, cols] and nonzero where the sensor has a lenslet. A frame may have
  /// at most `capacity` vortices; VortexList counts those beyond. Throws UsageError where an option
  /// is out of its range, and Failure where there are fewer than 2×2 lenslets.
  WhitenedPlan(const WhitenedOptions& options, const Image<std::uint8_t>& lenslet_valid,
               std::size_t capacity);

  const WhitenedOptions& options() const { return options_; }
  std::size_t capacity() const { return cells_.capacity(); }
  int rows() const { return lenslet_valid_.rows(); }  ///< in lenslets
  int cols() const { return lenslet_valid_.cols(); }
  const Image<std::uint8_t>& lenslet_valid() const { return lenslet_valid_; }
  /// Returns how many nodes have three or four lenslets that the sensor has.
  int n_nodes() const { return n_nodes_; }
  /// Returns the |t| that a vortex must exceed, for the stated false alarms of all these nodes.
  float threshold_sigmas() const { return threshold_sigmas_; }
  std::uint32_t flags_when_missing(int row, int col) const {
    return cells_.flags_when_missing(row, col);
  }

 private:
  WhitenedOptions options_;
  Image<std::uint8_t> lenslet_valid_;
  CirculationPlan cells_;
  int n_nodes_ = 0;
  float threshold_sigmas_ = 0;
};

/// These are the buffers of one frame, made once.
struct WhitenedWorkspace {
  explicit WhitenedWorkspace(const WhitenedPlan& plan);

  /// A sighting is a node that passed both tests.
  struct Sighting {
    std::int32_t row = 0;
    std::int32_t col = 0;
    std::int32_t charge = 0;
    std::int32_t partner = -1;  ///< index of the sighting with which it makes a pair
    float log_odds = 0;
    float z = 0;
    float t = 0;
    Vortex vortex;
  };

  /// [rows, cols] nonzero for the lenslets whose darkness says something in this frame. The beam
  /// does not reach the others. The caller sets it; at first it is the sensor's lenslets.
  Image<std::uint8_t> lit;
  WhitenedPlanes planes;
  /// The caller says by this that `planes` are those of the frame already, by a plan that
  /// filter_alike() says is like this one.
  bool is_filled = false;
  FixedList<Sighting> seen;
  Image<std::int32_t> seen_at;  ///< [rows−1, cols−1] of nodes: index into seen, or −1
};

/// Says whether two plans for one sensor differ at most in their rate of false alarms, so that the
/// planes of a frame are the same.
bool filter_alike(const WhitenedPlan& a, const WhitenedPlan& b);

/// Finds the vortices of one frame, the surest first; `vortices` is cleared first. It never
/// allocates. Slopes and flux are [rows, cols], and missing slopes are 0 with valid 0.
/// `circulation` is that of these slopes.
///
/// At a node, let d be the D of its 3×3 cells, m the pattern, and Σ the covariance of d for slopes
/// of variance noise/flux + clutter. (D is a linear stencil of slopes. A missing slope has a huge
/// variance, so that sums without it still count.) The filter is w = Σ⁻¹m. Two numbers follow from
/// it:
/// - t = wᵀd / √(wᵀΣₙw), where Σₙ follows from the slopes' own variances and covariances. It is
///   standard normal where there is slope noise and nothing else, and must pass the threshold of
///   the stated rate.
/// - z = wᵀd / √(mᵀΣ⁻¹m), where mᵀΣ⁻¹m is the information, which says how well a vortex here would
///   be seen. A logistic function calibrated on simulated fields makes a probability of z and of
///   how dark a hole the node lies in (vortices are zeros of the field).
///
/// A node is a vortex if it passes both tests, if three of its four lenslets are lit, and if
/// no neighbour of its sign that also passes has better odds. The significance is |t|, and
/// kMaxSignificance where there is no noise. A pair that cannot be told apart has charge 0 and lies
/// midway. It has kVortexUnresolvedPair, the sum of the two D, and the lesser of the two
/// probabilities.
void find_whitened_vortices(const WhitenedPlan& plan, const SlopeField& slopes,
                            const Image<float>& flux_adu, const CirculationMap& circulation,
                            WhitenedWorkspace& workspace, VortexList& vortices) noexcept;

}  // namespace curlew
