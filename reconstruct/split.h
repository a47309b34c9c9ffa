// This file declares the least-squares (Helmholtz–Hodge) split of a slope field, which is exact on
// any pupil.
//
// It is s = Γφ + s_sol with s_sol orthogonal to every Γφ in the weight of the fit. Γ is Fried's
// geometry on the lattice of core/lattice.h. Therefore ΓᵀWΓ is a graph Laplacian on each
// sublattice, and the circulation of Γφ is zero in exact arithmetic.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "core/hodge_split.h"
#include "core/lattice.h"
#include "core/slope_field.h"
#include "reconstruct/cholesky_factor.h"

namespace curlew {

struct SplitOptions {
  /// If true, every lenslet has its inverse variance, 2/(σx²+σy²), as its weight. If false, all
  /// weights are equal.
  bool weighted = false;
  /// Conjugate gradients are used with weights or where lenslets have faded. They end when the part
  /// of the fit's energy still missing, in the norm of the unweighted fit, is below tolerance²
  /// times that of the first estimate.
  double tolerance = 1e-6;
  int max_iterations = 200;
};

/// The plan holds all that follows from the pupil: the lattice and the factor of its Laplacian.
class SplitPlan {
 public:
  /// `valid` is [rows, cols] and non-zero where a lenslet is lit. Throws Failure where none is.
  SplitPlan(const Image<std::uint8_t>& valid, const SplitOptions& options);

  /// This is one lenslet's place in slope maps and among the unknowns.
  struct Lenslet {
    std::int32_t k;
    std::array<std::int32_t, 4> node;  ///< nodes of its corners 00, 01, 10, 11
  };
  /// This step gives ψ of a face from that of its neighbour, across one edge of one lenslet.
  struct PotentialStep {
    std::int32_t face;
    std::int32_t from_face;
    std::int32_t edge;  ///< 2·lenslet for edge A, +1 for edge B
    float sign;
  };

  const Lattice& lattice() const { return lattice_; }
  const SplitOptions& options() const { return options_; }
  const CholeskyFactor& factor() const { return factor_; }
  const std::vector<Lenslet>& lenslets() const { return lenslets_; }
  const std::vector<PotentialStep>& potential_steps() const { return potential_steps_; }
  /// Returns the lenslets that border a hole of the pupil.
  const std::vector<std::int32_t>& hole_borders() const { return hole_borders_; }
  int n_nodes() const { return lattice_.n_nodes(); }

 private:
  Eigen::SparseMatrix<double> laplacian() const;
  void plan_potential();
  void plan_hole_borders();

  SplitOptions options_;
  Lattice lattice_;
  std::vector<Lenslet> lenslets_;  // node: unknowns in elimination order, then the pinned nodes
  CholeskyFactor factor_;
  std::vector<PotentialStep> potential_steps_;
  std::vector<std::int32_t> hole_borders_;
};

/// This is one frame's scratch memory; it belongs to one slot.
class SplitWorkspace {
 public:
  explicit SplitWorkspace(const SplitPlan& plan);

 private:
  friend class Splitter;
  Lattice lattice_;              // lattice of a frame in which lenslets have faded
  AlignedVector<float> weight_;  // [lenslets]
  AlignedVector<float> edge_;    // [2·lenslets] residual on edges A and B
  AlignedVector<float> step_edge_;
  AlignedVector<float> phi_;  // [nodes]
  AlignedVector<float> gradient_;
  AlignedVector<float> solved_;
  AlignedVector<float> direction_;
  AlignedVector<float> group_sum_;  // [phase groups ≤ lenslets]
  AlignedVector<std::int32_t> group_count_;
  AlignedVector<std::int32_t> group_order_;  // [phase groups] the largest first
  AlignedVector<std::int32_t> group_rank_;   // [phase groups]
  AlignedVector<float> psi_;                 // [faces]
};

/// Splits one frame. Lenslets of the plan that are not valid in `slopes` are left out of the fit:
/// the answer is the least-squares one on the lattice that remains, and phase and slopes are 0 at
/// these lenslets. The parts that they leave are numbered. A lenslet that is valid in `slopes` must
/// be valid in the plan. Relative to the largest value, slopes are accurate to 1e-6 and the phase
/// to 2e-5 (in float; see tests/reconstruct).
void split_slopes(const SplitPlan& plan, const SlopeField& slopes, SplitWorkspace& workspace,
                  HodgeSplit& split) noexcept;

}  // namespace curlew
