#include "reconstruct/split.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/size_check.h"

namespace curlew {

SplitWorkspace::SplitWorkspace(const SplitPlan& plan)
    : lattice_(plan.lattice().rows(), plan.lattice().cols()),
      weight_(plan.lenslets().size()),
      edge_(2 * plan.lenslets().size()),
      step_edge_(2 * plan.lenslets().size()),
      phi_(static_cast<std::size_t>(plan.n_nodes())),
      gradient_(phi_.size()),
      solved_(phi_.size()),
      direction_(phi_.size()),
      group_sum_(plan.lenslets().size()),
      group_count_(plan.lenslets().size()),
      group_order_(plan.lenslets().size()),
      group_rank_(plan.lenslets().size()),
      psi_(static_cast<std::size_t>(plan.lattice().n_faces())) {}

/// A Splitter holds the steps of split_slopes() and what they share.
class Splitter {
 public:
  Splitter(const SplitPlan& plan, const SlopeField& slopes, SplitWorkspace& workspace,
           HodgeSplit& split)
      : plan_(plan), slopes_(slopes), ws_(workspace), split_(split) {}

  void run() noexcept {
    choose_weights();
    load_edges();
    split_.iterations = 0;
    split_.converged = true;
    if (equal_ && n_faded_ == 0)
      solve_directly();
    else
      solve_iteratively();
    store_slopes();
    store_phase();
    store_potential();
    store_holes();
  }

 private:
  using Lenslet = SplitPlan::Lenslet;
  static std::size_t index(std::int32_t i) { return static_cast<std::size_t>(i); }

  /// Sets the weights. A weight is 0 where the lenslet has faded. Otherwise it is 1, or 2/(σx²+σy²)
  /// divided by the mean of that.
  void choose_weights() noexcept {
    n_faded_ = 0;
    equal_ = !plan_.options().weighted;
    double sum = 0.0;
    for (std::size_t m = 0; m < ws_.weight_.size(); ++m) {
      const auto k = index(plan_.lenslets()[m].k);
      ws_.weight_[m] = slopes_.valid[k] != 0 ? 1.0F : 0.0F;
      if (slopes_.valid[k] == 0) {
        ++n_faded_;
        continue;
      }
      const float variance = 0.5F * (slopes_.variance_x[k] + slopes_.variance_y[k]);
      if (!(variance > 0.0F) || !std::isfinite(variance)) equal_ = true;  // No noise is known.
      if (!equal_) sum += 1.0 / static_cast<double>(variance);
    }
    if (equal_) return;
    const auto scale = static_cast<float>(
        static_cast<double>(ws_.weight_.size() - static_cast<std::size_t>(n_faded_)) / sum);
    for (std::size_t m = 0; m < ws_.weight_.size(); ++m) {
      const auto k = index(plan_.lenslets()[m].k);
      if (ws_.weight_[m] != 0.0F)
        ws_.weight_[m] = scale * 2.0F / (slopes_.variance_x[k] + slopes_.variance_y[k]);
    }
  }

  /// Sets the edges to the slopes less their mean. The mean is a plane and so exactly a gradient.
  /// Taking it out first keeps float differences of φ small.
  void load_edges() noexcept {
    double sum_x = 0.0;
    double sum_y = 0.0;
    for (const Lenslet& lenslet : plan_.lenslets()) {
      const auto k = index(lenslet.k);
      if (slopes_.valid[k] == 0) continue;
      sum_x += static_cast<double>(slopes_.x[k]);
      sum_y += static_cast<double>(slopes_.y[k]);
    }
    const double n = std::max<double>(1.0, static_cast<double>(ws_.weight_.size()) - n_faded_);
    mean_x_ = static_cast<float>(sum_x / n);
    mean_y_ = static_cast<float>(sum_y / n);
    for (std::size_t m = 0; m < ws_.weight_.size(); ++m) {
      const auto k = index(plan_.lenslets()[m].k);
      const bool valid = ws_.weight_[m] != 0.0F;
      const float x = slopes_.x[k] - mean_x_;
      const float y = slopes_.y[k] - mean_y_;
      ws_.edge_[2 * m] = valid ? x + y : 0.0F;
      ws_.edge_[2 * m + 1] = valid ? y - x : 0.0F;
    }
  }

  /// Computes out = ΓᵀW·edge on the nodes.
  void weighted_divergence(const AlignedVector<float>& edge, AlignedVector<float>& out) noexcept {
    std::fill(out.begin(), out.end(), 0.0F);
    for (std::size_t m = 0; m < ws_.weight_.size(); ++m) {
      const auto& node = plan_.lenslets()[m].node;
      const float a = ws_.weight_[m] * edge[2 * m];
      const float b = ws_.weight_[m] * edge[2 * m + 1];
      out[index(node[0])] -= a;
      out[index(node[3])] += a;
      out[index(node[1])] -= b;
      out[index(node[2])] += b;
    }
  }

  /// Computes out = A⁻¹·in with the unweighted Laplacian of the whole pupil. The result is 0 at
  /// pinned nodes.
  void solve_laplacian(const AlignedVector<float>& in, AlignedVector<float>& out) noexcept {
    const int n = plan_.factor().size();
    std::copy_n(in.begin(), n, out.begin());
    std::fill(out.begin() + n, out.end(), 0.0F);
    plan_.factor().solve_in_place(out.data());
  }

  void solve_directly() noexcept {
    weighted_divergence(ws_.edge_, ws_.gradient_);
    solve_laplacian(ws_.gradient_, ws_.phi_);
  }

  /// Solves by conjugate gradients on least squares (CGLS). The residual is kept on the edges,
  /// where float is accurate. The system is singular where faded lenslets split a component, but it
  /// stays consistent. k faded lenslets change 2k eigenvalues, so that at most 2k+1 steps are
  /// needed in exact arithmetic.
  void solve_iteratively() noexcept {
    std::fill(ws_.phi_.begin(), ws_.phi_.end(), 0.0F);
    std::fill(ws_.direction_.begin(), ws_.direction_.end(), 0.0F);
    weighted_divergence(ws_.edge_, ws_.gradient_);
    solve_laplacian(ws_.gradient_, ws_.solved_);
    double energy = dot(ws_.gradient_, ws_.solved_);
    const double goal = plan_.options().tolerance * plan_.options().tolerance * energy;
    double previous = 0.0;
    while (energy > goal && energy > 0.0) {
      if (split_.iterations == plan_.options().max_iterations) {
        split_.converged = false;
        return;
      }
      ++split_.iterations;
      const auto beta = static_cast<float>(previous > 0.0 ? energy / previous : 0.0);
      for (std::size_t i = 0; i < ws_.direction_.size(); ++i)
        ws_.direction_[i] = ws_.solved_[i] + beta * ws_.direction_[i];
      const double curvature = apply_direction();
      if (!(curvature > 0.0)) {
        split_.converged = curvature == 0.0;  // NaN means that slopes are too large for float.
        return;
      }
      const auto alpha = static_cast<float>(energy / curvature);
      for (std::size_t i = 0; i < ws_.phi_.size(); ++i) ws_.phi_[i] += alpha * ws_.direction_[i];
      for (std::size_t i = 0; i < ws_.edge_.size(); ++i) ws_.edge_[i] -= alpha * ws_.step_edge_[i];
      weighted_divergence(ws_.edge_, ws_.gradient_);
      solve_laplacian(ws_.gradient_, ws_.solved_);
      previous = energy;
      energy = dot(ws_.gradient_, ws_.solved_);
    }
  }

  /// Computes step_edge = Γ·direction and returns its weighted square.
  double apply_direction() noexcept {
    double sum = 0.0;
    for (std::size_t m = 0; m < ws_.weight_.size(); ++m) {
      const auto& node = plan_.lenslets()[m].node;
      const auto& p = ws_.direction_;
      const float a = p[index(node[3])] - p[index(node[0])];
      const float b = p[index(node[2])] - p[index(node[1])];
      ws_.step_edge_[2 * m] = a;
      ws_.step_edge_[2 * m + 1] = b;
      sum += static_cast<double>(ws_.weight_[m] * (a * a + b * b));
    }
    return sum;
  }

  static double dot(const AlignedVector<float>& a, const AlignedVector<float>& b) noexcept {
    double sum = 0.0;
    for (std::size_t i = 0; i < a.size(); ++i)
      sum += static_cast<double>(a[i]) * static_cast<double>(b[i]);
    return sum;
  }

  /// Stores the curl-free slopes Γφ and what is left of the slopes. The edges then hold w·e of the
  /// solenoidal part.
  void store_slopes() noexcept {
    for (std::size_t m = 0; m < ws_.weight_.size(); ++m) {
      const Lenslet& lenslet = plan_.lenslets()[m];
      const auto k = index(lenslet.k);
      const float w = ws_.weight_[m];
      if (w == 0.0F) {
        split_.curl_free_x[k] = split_.curl_free_y[k] = 0.0F;
        split_.solenoidal_x[k] = split_.solenoidal_y[k] = 0.0F;
        ws_.edge_[2 * m] = ws_.edge_[2 * m + 1] = 0.0F;
        continue;
      }
      const float a = ws_.phi_[index(lenslet.node[3])] - ws_.phi_[index(lenslet.node[0])];
      const float b = ws_.phi_[index(lenslet.node[2])] - ws_.phi_[index(lenslet.node[1])];
      const float x = 0.5F * (a - b);
      const float y = 0.5F * (a + b);
      const float solenoidal_x = slopes_.x[k] - mean_x_ - x;
      const float solenoidal_y = slopes_.y[k] - mean_y_ - y;
      split_.curl_free_x[k] = mean_x_ + x;
      split_.curl_free_y[k] = mean_y_ + y;
      split_.solenoidal_x[k] = solenoidal_x;
      split_.solenoidal_y[k] = solenoidal_y;
      ws_.edge_[2 * m] = w * (solenoidal_x + solenoidal_y);
      ws_.edge_[2 * m + 1] = w * (solenoidal_y - solenoidal_x);
    }
  }

  /// Stores φ at the lenslet centres. It is the mean over four corners, with mean zero over each
  /// part of the pupil.
  void store_phase() noexcept {
    if (n_faded_ > 0) ws_.lattice_.build(slopes_.valid);
    const Lattice& lattice = n_faded_ > 0 ? ws_.lattice_ : plan_.lattice();
    const auto n_groups = static_cast<std::size_t>(lattice.n_phase_groups());
    std::fill_n(ws_.group_sum_.begin(), n_groups, 0.0F);
    std::fill_n(ws_.group_count_.begin(), n_groups, 0);
    const int cols = slopes_.cols();
    for (const Lenslet& lenslet : plan_.lenslets()) {
      const auto k = index(lenslet.k);
      if (slopes_.valid[k] == 0) {
        split_.phase[k] = 0.0F;
        continue;
      }
      const int row = lenslet.k / cols;
      const int col = lenslet.k % cols;
      const auto& node = lenslet.node;
      const float phase = 0.25F * (ws_.phi_[index(node[0])] + ws_.phi_[index(node[1])] +
                                   ws_.phi_[index(node[2])] + ws_.phi_[index(node[3])]) +
                          mean_x_ * static_cast<float>(col) + mean_y_ * static_cast<float>(row);
      const auto group = index(lattice.phase_group_of(lenslet.k));
      split_.phase[k] = phase;
      ws_.group_sum_[group] += phase;
      ++ws_.group_count_[group];
    }
    for (std::size_t g = 0; g < n_groups; ++g)
      ws_.group_sum_[g] /= static_cast<float>(ws_.group_count_[g]);
    rank_groups(n_groups);
    for (const Lenslet& lenslet : plan_.lenslets()) {
      const auto k = index(lenslet.k);
      if (slopes_.valid[k] == 0) {
        split_.island[k] = HodgeSplit::kNoIsland;
        continue;
      }
      const auto group = index(lattice.phase_group_of(lenslet.k));
      split_.phase[k] -= ws_.group_sum_[group];
      split_.island[k] = ws_.group_rank_[group];
    }
  }

  /// Numbers the phase groups by their sizes, the largest first, and counts them.
  void rank_groups(std::size_t n_groups) noexcept {
    const auto begin = ws_.group_order_.begin();
    const auto end = begin + static_cast<std::ptrdiff_t>(n_groups);
    std::iota(begin, end, 0);
    std::sort(begin, end, [&](std::int32_t a, std::int32_t b) {
      const std::int32_t size_a = ws_.group_count_[index(a)];
      const std::int32_t size_b = ws_.group_count_[index(b)];
      return size_a != size_b ? size_a > size_b : a < b;
    });
    split_.n_islands = static_cast<int>(n_groups);
    split_.n_large_islands = 0;
    for (std::size_t rank = 0; rank < n_groups; ++rank) {
      const auto group = index(ws_.group_order_[rank]);
      ws_.group_rank_[group] = static_cast<std::int32_t>(rank);
      if (ws_.group_count_[group] >= HodgeSplit::kLargeIsland) ++split_.n_large_islands;
    }
  }

  /// Stores ψ by adding up w·e across edges, from the outside in. A faded lenslet adds nothing.
  /// This is right, because the faces on both its sides have become one.
  void store_potential() noexcept {
    ws_.psi_[0] = ws_.psi_[1] = 0.0F;
    for (const SplitPlan::PotentialStep& step : plan_.potential_steps())
      ws_.psi_[index(step.face)] =
          ws_.psi_[index(step.from_face)] + step.sign * ws_.edge_[index(step.edge)];
    const Lattice& lattice = plan_.lattice();
    for (int row = 0; row < split_.potential.rows(); ++row)
      for (int col = 0; col < split_.potential.cols(); ++col)
        split_.potential(row, col) =
            ws_.psi_[index(lattice.face_of((row + 1) * lattice.corner_cols() + col + 1))];
  }

  void store_holes() noexcept {
    const Lattice& lattice = n_faded_ > 0 ? ws_.lattice_ : plan_.lattice();
    split_.holes.clear();
    for (const LatticeHole& hole : lattice.holes())
      split_.holes.push({hole.x, hole.y, 0.0F, hole.loops_even == 0 || hole.loops_odd == 0});
    if (lattice.holes().empty()) return;
    if (n_faded_ == 0) {
      for (const std::int32_t m : plan_.hole_borders()) add_to_holes(lattice, index(m));
    } else {
      for (std::size_t m = 0; m < ws_.weight_.size(); ++m) add_to_holes(lattice, m);
    }
  }

  /// Adds a lenslet's edges to the loops of the holes beside it. Edge A (00 → 11) runs round corner
  /// 10 in the positive sense and round corner 01 in the negative. Edge B (01 → 10) does so round
  /// corners 00 and 11.
  void add_to_holes(const Lattice& lattice, std::size_t m) noexcept {
    const std::int32_t k = plan_.lenslets()[m].k;
    if (slopes_.valid[index(k)] == 0) return;
    const auto corner = lattice.corners_of(k);
    const float a = slopes_.x[index(k)] + slopes_.y[index(k)];
    const float b = slopes_.y[index(k)] - slopes_.x[index(k)];
    const float along[4] = {b, -a, a, -b};
    for (std::size_t i = 0; i < 4; ++i) {
      const int hole = lattice.hole_of_face(lattice.face_of(corner[i]));
      if (hole < 0) continue;
      HoleCirculation& h = split_.holes[index(hole)];
      h.circulation += (h.one_sublattice ? 1.0F : 0.5F) * along[i];
    }
  }

  const SplitPlan& plan_;
  const SlopeField& slopes_;
  SplitWorkspace& ws_;
  HodgeSplit& split_;
  int n_faded_ = 0;
  bool equal_ = true;
  float mean_x_ = 0.0F;
  float mean_y_ = 0.0F;
};

void split_slopes(const SplitPlan& plan, const SlopeField& slopes, SplitWorkspace& workspace,
                  HodgeSplit& split) noexcept {
  check_size("split_slopes", "slopes", size_of(slopes), size_of(plan.lattice()));
  check_size("split_slopes", "a split", size_of(split.phase), size_of(plan.lattice()));
  Splitter(plan, slopes, workspace, split).run();
}

}  // namespace curlew
