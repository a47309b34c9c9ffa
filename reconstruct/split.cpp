#include "reconstruct/split.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/as_size.h"
#include "core/size_check.h"
#include "reconstruct/split_rows.h"

namespace curlew {

SplitWorkspace::SplitWorkspace(const SplitPlan& plan)
    : faded_(plan.faces()),
      lattice_(plan.lattice().rows(), plan.lattice().cols()),
      weight_(plan.grid().size()),
      edge_a_(plan.grid().size()),
      edge_b_(plan.grid().size()),
      residual_(plan.grid().size()),
      phi_(plan.grid().size()),
      exact_phi_(plan.grid().size()),
      psi_(plan.grid().size()),
      nodes_(plan.node_places().size() + 1),
      group_sum_(plan.lenslets().size()),
      group_count_(plan.lenslets().size()),
      group_order_(plan.lenslets().size()),
      group_rank_(plan.lenslets().size()),
      solver_(plan.solver()),
      correction_(plan.solver(), 2 * plan.lenslets().size()),
      network_(plan.network()) {}

/// A Splitter holds the steps of split_slopes() and what they share.
class Splitter {
 public:
  Splitter(const SplitPlan& plan, const SlopeField& slopes, SplitWorkspace& workspace,
           HodgeSplit& split)
      : plan_(plan), grid_(plan.grid()), slopes_(slopes), ws_(workspace), split_(split) {
    check_size("split_slopes", "slopes", size_of(slopes), size_of(plan.lattice()));
    check_size("split_slopes", "a split", size_of(split.phase), size_of(plan.lattice()));
  }

  /// Starts on new weights.
  void forget_factor() noexcept { ws_.factorised_ = false; }

  void run() noexcept {
    prepare();
    split_.iterations = 0;
    split_.converged = true;
    ws_.faded_.find(plan_.faces(), slopes_, plan_.lenslets().size() - as_size(sums_.n));
    if (!(equal_ && solve_by_blocks())) solve_by_network();
    store();
  }

 private:
  /// Sets weights and edges.
  void prepare() noexcept {
    equal_ = !plan_.options().weighted;
    sums_ = weigh_lenslets(grid_, plan_.lit().data(), slopes_, !equal_, ws_.weight_.data());
    if (!equal_ && !sums_.noise_is_known) {
      equal_ = true;
      sums_ = weigh_lenslets(grid_, plan_.lit().data(), slopes_, false, ws_.weight_.data());
    }
    const float scale = equal_ || sums_.n == 0 ? 1.0F : static_cast<float>(sums_.n) / sums_.weight;
    largest_edge_ = load_edges(grid_, slopes_, sums_, scale, ws_.weight_.data(), ws_.edge_a_.data(),
                               ws_.edge_b_.data());
  }

  void gather(const AlignedVector<float>& corners) noexcept {
    const std::vector<std::size_t>& place = plan_.node_places();
    for (std::size_t i = 0; i < place.size(); ++i) ws_.nodes_[i] = corners[place[i]];
  }
  void scatter(AlignedVector<float>& corners) noexcept {
    const std::vector<std::size_t>& place = plan_.node_places();
    for (std::size_t i = 0; i < place.size(); ++i) corners[place[i]] = ws_.nodes_[i];
  }

  /// Solves with the blocks that were made of the pupil, and corrects for the edges that have
  /// faded. Returns false where a factor of the frame's weights is likely to be faster, or was
  /// needed.
  bool solve_by_blocks() noexcept {
    ws_.correction_.clear();
    const std::vector<std::int32_t>& node = plan_.node_of_corner();
    for (const FadedLenslets::Edge& edge : ws_.faded_.edges())
      ws_.correction_.add(node[as_size(edge.from)], node[as_size(edge.to)]);
    if (!ws_.faded_.lenslets().empty() &&
        ws_.correction_.predict_ns(plan_.solver()) > plan_.network().predict_ns())
      return false;
    find_divergence(grid_, ws_.edge_a_.data(), ws_.edge_b_.data(), ws_.residual_.data());
    gather(ws_.residual_);
    const float goal = static_cast<float>(plan_.options().tolerance) * largest_edge_;
    const int steps = ws_.correction_.solve(plan_.solver(), ws_.solver_, goal, ws_.nodes_.data());
    if (steps < 0) return false;
    split_.iterations = steps;
    scatter(ws_.phi_);
    return true;
  }

  /// Solves with a factor of this frame's weights. It is in float, so that the solution is refined:
  /// what is left is found in double and solved for again. Every step leaves a fixed part of the
  /// error, which the last two steps tell.
  void solve_by_network() noexcept {
    if (!ws_.factorised_) plan_.network().factorise(ws_.weight_.data(), ws_.network_);
    ws_.factorised_ = true;
    std::fill(ws_.exact_phi_.begin(), ws_.exact_phi_.end(), 0.0);
    auto previous = static_cast<double>(step_by_network());
    const double goal =
        plan_.options().tolerance * std::max(previous, static_cast<double>(largest_edge_));
    while (previous > 0.0) {
      if (split_.iterations == plan_.options().max_iterations || !std::isfinite(previous)) {
        split_.converged = false;
        break;
      }
      ++split_.iterations;
      const auto change = static_cast<double>(step_by_network());
      if (change * change <= goal * previous) break;
      previous = change;
    }
    for (std::size_t i = 0; i < ws_.phi_.size(); ++i)
      ws_.phi_[i] = static_cast<float>(ws_.exact_phi_[i]);
  }

  /// Does one step, and returns the largest change of an edge.
  float step_by_network() noexcept {
    find_residual(grid_, ws_.weight_.data(), ws_.edge_a_.data(), ws_.edge_b_.data(),
                  ws_.exact_phi_.data(), ws_.residual_.data());
    gather(ws_.residual_);
    plan_.network().solve(ws_.network_, ws_.nodes_.data());
    scatter(ws_.phi_);
    return add_step(grid_, ws_.weight_.data(), ws_.phi_.data(), ws_.exact_phi_.data());
  }

  void store() noexcept {
    const float sum = store_slopes(grid_, slopes_, sums_, ws_.weight_.data(), ws_.phi_.data(),
                                   ws_.edge_a_.data(), ws_.edge_b_.data(), split_);
    const bool any_cut_off = ws_.faded_.any_part_cut_off();
    if (any_cut_off) ws_.lattice_.build_parts(slopes_.valid);
    const Lattice& lattice = any_cut_off ? ws_.lattice_ : plan_.lattice();
    if (lattice.n_phase_groups() == 1) {
      subtract_mean(grid_, ws_.weight_.data(), sum / static_cast<float>(std::max(sums_.n, 1)),
                    split_);
      store_one_island();
    } else {
      subtract_group_means(lattice);
    }
    store_potential();
    ws_.faded_.store_holes(plan_.faces(), slopes_, split_.holes);
  }

  /// Gives the phase mean zero over each part of the pupil.
  void subtract_group_means(const Lattice& lattice) noexcept {
    const auto n_groups = as_size(lattice.n_phase_groups());
    std::fill_n(ws_.group_sum_.begin(), n_groups, 0.0F);
    std::fill_n(ws_.group_count_.begin(), n_groups, 0);
    for (const std::int32_t k : plan_.lenslets()) {
      if (slopes_.valid[as_size(k)] == 0) continue;
      const auto group = as_size(lattice.phase_group_of(k));
      ws_.group_sum_[group] += split_.phase[as_size(k)];
      ++ws_.group_count_[group];
    }
    for (std::size_t g = 0; g < n_groups; ++g)
      ws_.group_sum_[g] /= static_cast<float>(std::max(ws_.group_count_[g], 1));
    rank_groups(n_groups);
    std::fill(split_.island.begin(), split_.island.end(), HodgeSplit::kNoIsland);
    for (const std::int32_t lenslet : plan_.lenslets()) {
      const std::size_t k = as_size(lenslet);
      if (slopes_.valid[k] == 0) continue;
      const auto group = as_size(lattice.phase_group_of(lenslet));
      split_.phase[k] -= ws_.group_sum_[group];
      split_.island[k] = ws_.group_rank_[group];
    }
  }

  /// Numbers the phase groups by their sizes, the largest first, and counts those that hold a
  /// lenslet.
  void rank_groups(std::size_t n_groups) noexcept {
    const auto begin = ws_.group_order_.begin();
    const auto end = begin + static_cast<std::ptrdiff_t>(n_groups);
    std::iota(begin, end, 0);
    std::sort(begin, end, [&](std::int32_t a, std::int32_t b) {
      const std::int32_t size_a = ws_.group_count_[as_size(a)];
      const std::int32_t size_b = ws_.group_count_[as_size(b)];
      return size_a != size_b ? size_a > size_b : a < b;
    });
    split_.n_islands = split_.n_large_islands = 0;
    for (std::size_t rank = 0; rank < n_groups; ++rank) {
      const auto group = as_size(ws_.group_order_[rank]);
      ws_.group_rank_[group] = static_cast<std::int32_t>(rank);
      split_.n_islands += ws_.group_count_[group] > 0 ? 1 : 0;
      split_.n_large_islands += ws_.group_count_[group] >= HodgeSplit::kLargeIsland ? 1 : 0;
    }
  }

  /// Numbers all lenslets where the pupil has one part.
  void store_one_island() noexcept {
    for (std::size_t k = 0; k < split_.island.size(); ++k)
      split_.island[k] = slopes_.valid[k] != 0 ? 0 : HodgeSplit::kNoIsland;
    split_.n_islands = sums_.n > 0 ? 1 : 0;
    split_.n_large_islands = sums_.n >= HodgeSplit::kLargeIsland ? 1 : 0;
  }

  /// Stores ψ by adding up w·e across edges, from the outside in. A faded lenslet adds nothing.
  /// This is right, because the faces on both its sides have become one.
  void store_potential() noexcept {
    auto copy = plan_.potential_copies().begin();
    for (int row = 1; row < grid_.rows; ++row) {
      find_potential_row(grid_, row, plan_.from_left().data(), plan_.from_right().data(),
                         ws_.edge_a_.data(), ws_.edge_b_.data(), ws_.psi_.data());
      for (; copy != plan_.potential_copies().end() && copy->row == row; ++copy)
        ws_.psi_[copy->to] = ws_.psi_[copy->from];
      if (grid_.cols > 1)
        std::copy_n(&ws_.psi_[grid_.at(row, 1)], grid_.cols - 1, &split_.potential(row - 1, 0));
    }
  }

  const SplitPlan& plan_;
  const SplitGrid& grid_;
  const SlopeField& slopes_;
  SplitWorkspace& ws_;
  HodgeSplit& split_;
  FitSums sums_;
  bool equal_ = true;
  float largest_edge_ = 0.0F;
};

void split_slopes(const SplitPlan& plan, const SlopeField& slopes, SplitWorkspace& workspace,
                  HodgeSplit& split) noexcept {
  Splitter splitter(plan, slopes, workspace, split);
  splitter.forget_factor();
  splitter.run();
}

void split_again(const SplitPlan& plan, const SlopeField& slopes, SplitWorkspace& workspace,
                 HodgeSplit& split) noexcept {
  Splitter(plan, slopes, workspace, split).run();
}

}  // namespace curlew
