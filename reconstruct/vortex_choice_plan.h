// This file declares what the choice among vortices needs of the pupil: tiles, and the factors of
// their loops.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/image.h"
#include "core/lattice.h"
#include "reconstruct/cholesky_factor.h"

namespace curlew {

struct VortexChoiceOptions {
  /// Candidates less probable than this are not considered. It must be in (0, ½].
  float min_probability = 0.05F;
  /// This is the variance of one slope in rad² per pitch². It holds the noise, and what the model
  /// of a vortex does not explain.
  float slope_variance = 0.3F;
  /// This says how much the detector's own log-odds count beside the slopes.
  float prior_weight = 1.0F;
  /// This probability is taken where the detector gives none.
  float unknown_probability = 0.8F;
  /// This softens the vortices' slopes, in pitches²; see vortex_field.h. About 0.3 gives the
  /// circulations that propagated fields have.
  float softening = 0.3F;
};

/// A tile is a part of the array, with its faces and the factor of their Laplacian RᵀR, where R are
/// the edges between the faces. If l are the loops round the faces, lᵀ(RᵀR)⁻¹l is the energy of the
/// solenoidal part of the edges. Vortices beyond the tile need not be known, because their slopes
/// are a gradient inside it.
class ChoiceTile {
 public:
  /// This is a lenslet of the tile that the pupil has.
  struct Lenslet {
    std::int32_t row;  ///< of the array
    std::int32_t col;
    std::array<std::int32_t, 4> unknown;  ///< of the faces at its corners 00, 01, 10 and 11
  };

  /// `valid` is the map of the tile's lenslets, of which the first is (row, col) of the array.
  ChoiceTile(int row, int col, const Image<std::uint8_t>& valid);

  int row() const { return row_; }
  int col() const { return col_; }
  const Lattice& lattice() const { return lattice_; }
  const CholeskyFactor& factor() const { return factor_; }
  /// Returns the unknown of a corner's face, and −1 outside the pupil.
  std::int32_t unknown_of(int corner) const { return unknown_[static_cast<std::size_t>(corner)]; }
  const std::vector<Lenslet>& lenslets() const { return lenslets_; }

 private:
  CholeskyFactor make_factor() const;

  int row_;
  int col_;
  Lattice lattice_;
  CholeskyFactor factor_;
  std::vector<std::int32_t> unknown_;  // [corners]
  std::vector<Lenslet> lenslets_;
};

/// The plan divides the array into tiles. An array of up to kCore + 2·kMargin lenslets a side is
/// one tile. Larger ones are cut into cores, and the candidates of a core are judged with all that
/// lie up to kMargin round it.
class VortexChoicePlan {
 public:
  static constexpr int kCore = 16;
  static constexpr int kMargin = 4;

  /// `valid` is [rows, cols] and non-zero where the sensor has a lenslet. At most `capacity`
  /// candidates are judged.
  VortexChoicePlan(const Image<std::uint8_t>& valid, const VortexChoiceOptions& options,
                   std::size_t capacity);

  const VortexChoiceOptions& options() const { return options_; }
  std::size_t capacity() const { return capacity_; }
  int rows() const { return rows_; }  ///< in lenslets
  int cols() const { return cols_; }
  const std::vector<ChoiceTile>& tiles() const { return tiles_; }
  /// Returns the tile to which a candidate at (x, y) belongs, and −1 where that tile has no
  /// lenslet.
  std::int32_t tile_at(float x, float y) const;

 private:
  VortexChoiceOptions options_;
  std::size_t capacity_;
  int rows_;
  int cols_;
  int tile_rows_ = 1;
  int tile_cols_ = 1;
  std::vector<ChoiceTile> tiles_;
  std::vector<std::int32_t> tile_of_core_;  // [tile_rows, tile_cols]; −1 for none
};

}  // namespace curlew
