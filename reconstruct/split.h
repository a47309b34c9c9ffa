// This file declares the least-squares (Helmholtz–Hodge) split of a slope field, which is exact on
// any pupil.
//
// It is s = Γφ + s_sol with s_sol orthogonal to every Γφ in the weight of the fit. Γ is Fried's
// geometry on the lattice of core/lattice.h. Therefore ΓᵀWΓ is a graph Laplacian on each
// sublattice, and the circulation of Γφ is zero in exact arithmetic.
#pragma once

#include <cstdint>
#include <vector>

#include "core/hodge_split.h"
#include "core/lattice.h"
#include "core/slope_field.h"
#include "reconstruct/block_solver.h"
#include "reconstruct/dissection.h"
#include "reconstruct/fade_correction.h"
#include "reconstruct/faded_lenslets.h"
#include "reconstruct/network_factor.h"
#include "reconstruct/split_grid.h"

namespace curlew {

struct SplitOptions {
  /// If true, every lenslet has its inverse variance, 2/(σx²+σy²), as its weight. If false, all
  /// weights are equal.
  bool weighted = false;
  /// With weights, or where lenslets have faded, the solution is improved step by step, until the
  /// next step would change no slope by more than this part of the largest.
  double tolerance = 1e-6;
  int max_iterations = 200;
};

/// The plan holds all that follows from the pupil: the lattice, and how its Laplacian is solved.
class SplitPlan {
 public:
  /// `valid` is [rows, cols] and non-zero where a lenslet is lit. Throws Failure where none is.
  SplitPlan(const Image<std::uint8_t>& valid, const SplitOptions& options);

  /// This is a corner of a hole's face that gets its ψ from another corner of the same face.
  struct PotentialCopy {
    std::int32_t row;
    std::size_t to;
    std::size_t from;
  };

  const Lattice& lattice() const { return faces_.lattice(); }
  const PupilFaces& faces() const { return faces_; }
  const SplitOptions& options() const { return options_; }
  const SplitGrid& grid() const { return grid_; }
  /// Returns the lit lenslets, k = row·cols + col.
  const std::vector<std::int32_t>& lenslets() const { return faces_.lenslets(); }
  const BlockSolver& solver() const { return solver_; }
  const NetworkFactor& network() const { return network_; }
  /// Returns the places in working arrays of the nodes, in the order of elimination.
  const std::vector<std::size_t>& node_places() const { return node_places_; }
  /// Returns the position of each corner in that order; it means nothing where no node is.
  const std::vector<std::int32_t>& node_of_corner() const { return node_of_corner_; }
  const AlignedVector<float>& lit() const { return lit_; }  ///< 1 where a lenslet is lit
  /// These say from which side a corner's ψ follows (find_potential_row()).
  const AlignedVector<float>& from_left() const { return from_left_; }
  const AlignedVector<float>& from_right() const { return from_right_; }
  const std::vector<PotentialCopy>& potential_copies() const { return potential_copies_; }

 private:
  SplitPlan(const SplitOptions& options, const Lattice& lattice);
  SplitPlan(const SplitOptions& options, const Lattice& lattice, const Dissection& dissection);
  void plan_potential();

  SplitOptions options_;
  PupilFaces faces_;
  SplitGrid grid_;
  BlockSolver solver_;
  NetworkFactor network_;
  std::vector<std::size_t> node_places_;
  std::vector<std::int32_t> node_of_corner_;
  AlignedVector<float> lit_;
  AlignedVector<float> from_left_;
  AlignedVector<float> from_right_;
  std::vector<PotentialCopy> potential_copies_;
};

/// This is one frame's scratch memory; it belongs to one slot.
class SplitWorkspace {
 public:
  explicit SplitWorkspace(const SplitPlan& plan);

 private:
  friend class Splitter;
  FadedLenslets faded_;
  Lattice lattice_;  // lattice of a frame in which a part of the pupil has been cut off
  // These are working arrays (SplitGrid), by lenslets and by corners.
  AlignedVector<float> weight_;
  AlignedVector<float> edge_a_;
  AlignedVector<float> edge_b_;
  AlignedVector<float> residual_;
  AlignedVector<float> phi_;
  AlignedVector<double> exact_phi_;
  AlignedVector<float> psi_;
  AlignedVector<float> nodes_;      // [nodes + 1] in the order of elimination
  AlignedVector<float> group_sum_;  // [phase groups ≤ lenslets]
  AlignedVector<std::int32_t> group_count_;
  AlignedVector<std::int32_t> group_order_;  // [phase groups] the largest first
  AlignedVector<std::int32_t> group_rank_;   // [phase groups]
  BlockSolver::Workspace solver_;
  FadeCorrection correction_;
  bool factorised_ = false;  // whether network_ is the factor of the weights split last
  NetworkFactor::Workspace network_;
};

/// Splits one frame. Lenslets of the plan that are not valid in `slopes` are left out of the fit:
/// the answer is the least-squares one on the lattice that remains, and phase and slopes are 0 at
/// these lenslets. The parts that they leave are numbered. A lenslet that is valid in `slopes` must
/// be valid in the plan. Slopes are accurate to 1e-5 of the largest and the phase to 2e-5 of its
/// own (in float; see tests/reconstruct). Weights beyond 1e±9 of their mean count as that much.
void split_slopes(const SplitPlan& plan, const SlopeField& slopes, SplitWorkspace& workspace,
                  HodgeSplit& split) noexcept;

/// Splits other slopes with the weights of those that `workspace` split last: `valid` and the
/// variances are the same. The factor that was made for them is used again.
void split_again(const SplitPlan& plan, const SlopeField& slopes, SplitWorkspace& workspace,
                 HodgeSplit& split) noexcept;

}  // namespace curlew
