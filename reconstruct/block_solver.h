// A BlockSolver solves A·x = b for the Laplacian A of a pupil whose lenslets all have the weight 1.
// It keeps, in float, what a block factor in double gives.
//
// For the pivots p of a front and their border q, with the block S of A that is left of them when
// their turn comes, it keeps G = −S_qp·S_pp⁻¹ and S_pp⁻¹. On the way up the fronts, b_q += G·b_p;
// on the way down, x_p = S_pp⁻¹·b_p + Gᵀ·x_q. Both are products of a dense matrix with a vector.
// Where the lattice is regular many fronts have the same blocks, which are kept once.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/as_size.h"
#include "core/image.h"
#include "core/lattice.h"
#include "reconstruct/dissection.h"

namespace curlew {

class BlockSolver {
 public:
  /// `lattice` is the one that was dissected. x has one free constant a component; it is chosen so
  /// that x has sum 0 over the component's last nodes. The sum of b over a component must be 0.
  BlockSolver(const Lattice& lattice, const Dissection& dissection);

  /// This is the scratch memory of a solution.
  struct Workspace {
    explicit Workspace(const BlockSolver& solver);
    AlignedVector<float> in;
    AlignedVector<float> out;
  };

  /// Computes b ← A⁻¹·b. b is [n_nodes + 1] in the order of elimination; the last element is 0.
  void solve(Workspace& workspace, float* b) const noexcept;

  /// Computes the same on some fronts only, which are given by their indices, ascending, with all
  /// their ancestors. b must be 0 at the nodes of all other fronts, and x is found on these fronts
  /// only. solve_up() leaves what solve_down() needs in b.
  void solve_up(std::span<const std::int32_t> fronts, Workspace& workspace,
                float* b) const noexcept;
  void solve_down(std::span<const std::int32_t> fronts, Workspace& workspace,
                  float* b) const noexcept;

  std::span<const std::int32_t> all_fronts() const { return all_; }
  std::size_t bytes() const { return values_.size() * sizeof(float); }  ///< of the blocks kept

  /// This is one front's matrices, in columns whose length is a multiple of 16 floats.
  struct Block {
    std::int32_t first;
    std::int32_t pivots;
    std::int32_t border;        ///< number of nodes in it
    std::int32_t border_start;  ///< where its positions begin
    std::size_t up;             ///< G: a column a pivot, a row a node of the border
    std::size_t down;     ///< (S_pp⁻¹ Gᵀ): a column a pivot or border node, a row a pivot
    std::int32_t parent;  ///< front of the first node of its border; −1: no border
    float operations;     ///< multiplications of a solution, up and down
  };
  const Block& block(std::int32_t front) const { return blocks_[as_size(front)]; }
  /// Returns about how long a multiplication takes, ns. Blocks that the second-level cache cannot
  /// hold are waited for.
  double operation_ns() const { return bytes() < (std::size_t{3} << 19U) ? 0.034 : 0.085; }
  /// Returns the front of every node.
  const std::vector<std::int32_t>& front_of() const { return front_of_; }

 private:
  class Builder;

  std::vector<Block> blocks_;
  std::vector<std::int32_t> all_;
  AlignedVector<std::int32_t> border_;
  AlignedVector<float> values_;
  std::vector<std::int32_t> front_of_;
};

}  // namespace curlew
