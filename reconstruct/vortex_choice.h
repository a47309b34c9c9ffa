// Which candidates to believe: the set of vortices that the slopes as a whole speak for.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/fixed_list.h"
#include "core/lattice.h"
#include "core/slope_field.h"
#include "core/vortex.h"
#include "reconstruct/cholesky_factor.h"

namespace curlew {

struct VortexChoiceOptions {
  /// Candidates less probable than this are not considered; in (0, ½].
  float min_probability = 0.05F;
  /// Of one slope, rad² per pitch²: noise, and what the model of a vortex does not say of it.
  float slope_variance = 0.3F;
  /// How much the detector's own log-odds count beside the slopes.
  float prior_weight = 1.0F;
  /// Taken where the detector knows none.
  float unknown_probability = 0.8F;
  /// Softening of the vortices' slopes, pitches²; see vortex_field.h. About 0.3 gives the
  /// circulations that propagated fields have.
  float softening = 0.3F;
};

/// Part of the array, with its faces and the factor of their Laplacian RᵀR, R the edges that part
/// them: with l the loops round the faces, lᵀ(RᵀR)⁻¹l is the energy of the solenoidal part of the
/// edges. What lies beyond the tile need not be known: there it is a gradient.
class ChoiceTile {
 public:
  /// valid: of the tile's lenslets. Its first lenslet is (row, col) of the array.
  ChoiceTile(int row, int col, const Image<std::uint8_t>& valid);

  int row() const { return row_; }
  int col() const { return col_; }
  const Lattice& lattice() const { return lattice_; }
  const CholeskyFactor& factor() const { return factor_; }
  /// Unknown of a corner's face, −1 outside the pupil.
  std::int32_t unknown_of(int corner) const { return unknown_[static_cast<std::size_t>(corner)]; }
  /// The most elements that L⁻¹l of one vortex has.
  std::size_t longest_path() const { return longest_path_; }

 private:
  CholeskyFactor make_factor() const;

  int row_;
  int col_;
  Lattice lattice_;
  CholeskyFactor factor_;
  std::vector<std::int32_t> unknown_;  // [corners]
  std::size_t longest_path_ = 0;
};

/// An array of up to kCore + 2·kMargin lenslets a side is one tile. Larger ones are cut into cores,
/// and the candidates of a core are judged with all that lie up to kMargin round it.
class VortexChoicePlan {
 public:
  static constexpr int kCore = 16;
  static constexpr int kMargin = 4;

  /// valid: [rows, cols], non-zero where the sensor has a lenslet. capacity: the most candidates
  /// that are judged.
  VortexChoicePlan(const Image<std::uint8_t>& valid, const VortexChoiceOptions& options,
                   std::size_t capacity);

  const VortexChoiceOptions& options() const { return options_; }
  std::size_t capacity() const { return capacity_; }
  int rows() const { return rows_; }  ///< lenslets
  int cols() const { return cols_; }
  const std::vector<ChoiceTile>& tiles() const { return tiles_; }
  /// The tile that a candidate at (x, y) belongs to, −1 where there is no lenslet.
  std::int32_t tile_at(float x, float y) const;

 private:
  VortexChoiceOptions options_;
  std::size_t capacity_;
  int rows_;
  int cols_;
  int tile_rows_ = 1;
  int tile_cols_ = 1;
  std::vector<ChoiceTile> tiles_;
  std::vector<std::int32_t> tile_of_core_;  // [tile_rows, tile_cols] −1: none
};

/// Buffers of one frame, made once.
struct VortexChoiceWorkspace {
  explicit VortexChoiceWorkspace(const VortexChoicePlan& plan);

  FixedList<Vortex> candidates;
  AlignedVector<std::int32_t> tile;    ///< [candidates] each belongs to
  std::vector<std::uint8_t> believed;  ///< [candidates] the result

  // Of the tile in hand:
  FixedList<std::size_t> local;   ///< candidates in it
  AlignedVector<float> measured;  ///< [faces] L⁻¹ of the measured loops
  AlignedVector<float> scratch;   ///< [faces] 0 between uses
  std::vector<std::uint8_t> marked;
  AlignedVector<std::int32_t> element;  ///< L⁻¹ of each candidate's loops: where …
  AlignedVector<float> value;           ///< … and how much
  std::vector<std::size_t> start;       ///< [candidates + 1]
  Image<float> overlap;                 ///< [candidates, candidates] lᵀ(RᵀR)⁻¹l
  AlignedVector<float> gain;            ///< of each candidate, l against what is still unexplained
  AlignedVector<float> cost;            ///< −log-odds times prior_weight
  std::vector<std::uint8_t> chosen;
};

/// Chooses among candidates the set V that makes least
///   ½ Σ|s_sol − s_sol(V)|²/slope_variance − prior_weight·Σ_V ln(p/(1−p)),
/// s_sol the solenoidal part of the slopes, s_sol(V) that of the vortices. A vortex shows in every
/// slope of the pupil, as 1/r, so that one without its opposite costs much: what a detector, which
/// looks at a few lenslets, cannot know. From all with p ≥ ½ it goes downhill, changing its mind on
/// one or two candidates at a time. Unresolved pairs (charge 0), and what
/// lies over 2 pitches off the array, are left out. Candidates beyond the
/// capacity are not judged: give the surest first.
/// Lenslets that are not valid in the frame have the mean slope of their neighbours here.
/// chosen is cleared first; of the candidates that do not fit the overflow is counted.
void choose_vortices(const VortexChoicePlan& plan, const VortexList& candidates,
                     const SlopeField& slopes, VortexChoiceWorkspace& workspace,
                     VortexList& chosen) noexcept;

}  // namespace curlew
