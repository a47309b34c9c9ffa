// A FadeCorrection solves for a pupil in which a few lenslets have faded, with the blocks of the
// whole pupil.
//
// Let D have a column an edge that has faded, with +1 at one end and −1 at the other. The Laplacian
// without these edges is A − D·Dᵀ, and by M. Woodbury's formula
//     x = A⁻¹·(b + D·c)  with  (1 − Dᵀ·A⁻¹·D)·c = Dᵀ·A⁻¹·b.
// c is found by conjugate gradients, over the faded edges only. Each step solves with A, but only
// on the fronts that hold ends of these edges, and on their ancestors. Bridges must not be among
// the edges (faded_lenslets.h): the matrix would be singular, and no current flows across them
// anyway.
#pragma once

#include <cstddef>
#include <cstdint>

#include "core/fixed_list.h"
#include "core/image.h"
#include "reconstruct/block_solver.h"

namespace curlew {

class FadeCorrection {
 public:
  /// At most max_edges edges fade. All buffers are made here.
  FadeCorrection(const BlockSolver& solver, std::size_t max_edges);

  /// Starts a frame in which no edge has faded yet.
  void clear() noexcept { edges_.clear(); }
  /// Says that the edge between two nodes has faded; they are positions.
  void add(std::int32_t from, std::int32_t to) noexcept { edges_.push({from, to}); }

  /// Returns how long solve() will take, ns, as far as it can be foreseen. Only its ratio to
  /// NetworkFactor::predict_ns() matters.
  double predict_ns(const BlockSolver& solver) noexcept;

  /// Computes b ← x for the b above, [n_nodes + 1] in the order of elimination, until no edge is
  /// off by more than `goal`. predict_ns() must come before. Returns the number of steps,
  /// and −1 if twice as many as foreseen were not enough; b then means nothing.
  int solve(const BlockSolver& solver, BlockSolver::Workspace& workspace, float goal,
            float* b) noexcept;

 private:
  struct Edge {
    std::int32_t from;
    std::int32_t to;
  };
  double predict_steps() noexcept;
  float multiply_direction(const BlockSolver& solver, BlockSolver::Workspace& workspace) noexcept;
  void load_nodes(const BlockSolver& solver, const AlignedVector<float>& edge_values) noexcept;

  FixedList<Edge> edges_;
  double foreseen_steps_ = 0.0;
  FixedList<std::int32_t> fronts_;        // with ends of edges, and their ancestors, ascending
  AlignedVector<std::uint8_t> has_ends_;  // [fronts]
  AlignedVector<std::uint8_t> is_end_;    // [nodes] 0 between uses
  AlignedVector<float> c_;                // [edges]
  AlignedVector<float> residual_;
  AlignedVector<float> direction_;
  AlignedVector<float> product_;
  AlignedVector<float> nodes_;  // [n_nodes + 1]
};

}  // namespace curlew
