// The symmetry of the square, which the reviewer of the vortex classifier obeys.
#pragma once

#include <cstddef>
#include <vector>

#include "detect/classifier/classifier_network.h"

namespace curlew {

/// Keeps a judge equivariant: a patch that is turned or mirrored by one of the eight
/// symmetries of the square has the same probabilities and pairs, turned positions and, where it is
/// mirrored, the other charge. (After T. Cohen and M. Welling, "Group equivariant convolutional
/// networks", ICML 2016.) Hidden outputs come in eights, one for each symmetry, which permutes
/// them. The position's inverse covariance is a Cholesky factor, which a transposition does not
/// merely permute; its numbers obey the four symmetries without one, and training teaches the rest.
class NetworkSymmetry {
 public:
  /// The hidden outputs of the judge must be multiples of eight.
  explicit NetworkSymmetry(const JudgeLayers& judge);

  /// Replaces each number of a layer by its mean over the symmetries. What is symmetrical already
  /// stays as it is. `layer` counts from the judge's first.
  void symmetrise(std::size_t layer, AlignedVector<float>& weights,
                  AlignedVector<float>& bias) const;

 private:
  /// A symmetry moves number i of a layer's inputs or outputs to place[i] and multiplies it by
  /// sign[i], which is 0 where it does something else to it.
  struct Move {
    std::vector<std::size_t> place;
    std::vector<float> sign;
  };
  struct LayerMoves {
    std::vector<Move> inputs, outputs;  ///< one for each symmetry
  };

  std::vector<LayerMoves> layers_;
};

}  // namespace curlew
