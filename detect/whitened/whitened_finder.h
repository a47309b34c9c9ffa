// The interpretable detector: a matched filter on circulation, whitened by each lenslet's noise.
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

/// Numbers without a unit in their name were fitted to simulated turbulence, on other fields than
/// the benchmark's test fields.
struct WhitenedOptions {
  /// Mean number of vortices a frame, at most, where there is only slope noise, before less
  /// probable ones are left out. More than 0.
  double false_alarms_per_frame = 0.01;
  double min_probability = 0.5;  ///< less likely vortices are not reported; in (0, 1)

  /// What D looks like round a vortex, and how far slopes differ from that: the variance of a slope
  /// near a vortex, which other vortices and the bent phase give it. It is what keeps a bright
  /// lenslet from counting for everything. More than 0.
  VortexPattern pattern{};
  double slope_clutter_rad2 = 0.7;

  // ln of the odds = offset + per_sigma·z + per_darkness·darkness
  //                  + per_log_information·ln(clutter·information) + per_log_noise·ln(noise)
  double log_odds = -10.765;
  double log_odds_per_sigma = 4.0;
  double log_odds_per_darkness = 1.875;
  double log_odds_per_log_information = -1.17;
  double log_odds_per_log_noise = -0.82;

  /// The position is the node's, plus this much of the way to the centroid of D,
  double circulation_pull = 0.605;
  /// plus this many pitches per unit of brightness (a factor e in flux) towards the darker side.
  double darkness_pull = 0.158;
  double position_variance = 0.045;         ///< along an axis, pitches², of a vortex with z = ∞;
  double position_variance_per_z2 = 0.114;  ///< more with 1/z²

  /// Two opposite vortices of nearly the same strength, nearer than this many standard deviations
  /// of their separation and than 1¼ pitches, are one unresolved pair. 0: never.
  double pair_sigmas = 3.0;
  double pair_likely = 0.5;  ///< a probability: one above makes no pair with one below
};

/// All that follows from the options and the pupil. Const after construction, shared by threads.
class WhitenedPlan {
 public:
  /// lenslet_valid: [rows, cols], nonzero where the sensor has a lenslet. capacity: the most
  /// vortices a frame may have; VortexList counts what is more. Throws UsageError on options out
  /// of range and Failure on fewer than 2×2 lenslets.
  WhitenedPlan(const WhitenedOptions& options, const Image<std::uint8_t>& lenslet_valid,
               std::size_t capacity);

  const WhitenedOptions& options() const { return options_; }
  std::size_t capacity() const { return cells_.capacity(); }
  int rows() const { return lenslet_valid_.rows(); }  ///< lenslets
  int cols() const { return lenslet_valid_.cols(); }
  const Image<std::uint8_t>& lenslet_valid() const { return lenslet_valid_; }
  int n_nodes() const { return n_nodes_; }  ///< with three or four lenslets the sensor has
  /// |t| from which on a node may be a vortex, for the stated false alarms of all these nodes.
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

/// Buffers of one frame, made once.
struct WhitenedWorkspace {
  explicit WhitenedWorkspace(const WhitenedPlan& plan);

  /// A node that passed both tests.
  struct Sighting {
    std::int32_t row = 0;
    std::int32_t col = 0;
    std::int32_t charge = 0;
    std::int32_t partner = -1;  ///< the sighting it makes a pair with
    float log_odds = 0;
    float z = 0;
    float t = 0;
    Vortex vortex;
  };

  WhitenedPlanes planes;
  FixedList<Sighting> seen;
  Image<std::int32_t> seen_at;  ///< nodes, [rows−1, cols−1]: index into seen, or −1
};

/// Vortices of one frame, the surest first; `vortices` is cleared first. Never allocates.
/// slopes and flux: [rows, cols], missing slopes 0 with valid 0; circulation: of these slopes.
///
/// At a node with d the D of its 3×3 cells, m the pattern and Σ the covariance that slopes of
/// variance noise/flux + clutter give d (D is a linear stencil of slopes; a missing slope has a
/// huge variance, so that sums without it still count), the filter is w = Σ⁻¹m. From it
///   t = wᵀd / √(wᵀΣₙw), Σₙ from the slopes' own variances and covariances: standard normal where
///       there is slope noise and nothing else. It must pass the threshold of the stated rate.
///   z = wᵀd / √(mᵀΣ⁻¹m), mᵀΣ⁻¹m the information: how well a vortex here would be seen. It
///       judges, with how dark a hole the node lies in (vortices are zeros of the field), in a
///       logistic calibrated on simulated fields.
/// A node is a vortex if it passes both tests, the sensor has three of its four lenslets, and no
/// neighbour of its sign that also passes has better odds. significance is |t|, kMaxSignificance
/// where there is no noise. A pair that cannot be told apart has charge 0, lies midway and has
/// kVortexUnresolvedPair, the sum of the two D, and the lesser of the two probabilities.
void find_whitened_vortices(const WhitenedPlan& plan, const SlopeField& slopes,
                            const Image<float>& flux_adu, const CirculationMap& circulation,
                            WhitenedWorkspace& workspace, VortexList& vortices) noexcept;

}  // namespace curlew
