#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>

#include "reconstruct/block_solver.h"

namespace curlew {
namespace {

std::size_t padded(std::size_t n) { return (n + 15) / 16 * 16; }

/// Blocks are equal if they agree to this. It is less than what float resolves, because errors of
/// them count as much as φ is larger than its differences, and more than the rounding of double.
constexpr double kEqual = 1e-9;

}  // namespace

/// A Builder eliminates front after front in double.
class BlockSolver::Builder {
 public:
  Builder(const Lattice& lattice, const Dissection& dissection, BlockSolver& solver)
      : dissection_(dissection), solver_(solver), left_(dissection.fronts().size()) {
    last_front_.resize(as_size(lattice.n_components()));
    for (int i = 0; i < dissection.n_nodes(); ++i) {
      const int corner = dissection.corner_at(i);
      component_.push_back(lattice.component_of(corner));
      last_front_[as_size(component_.back())] = dissection.front_of()[as_size(i)];
      const int row = corner / lattice.corner_cols();
      const int col = corner % lattice.corner_cols();
      place_.push_back({row + col, col - row});
    }
    links_.resize(dissection.fronts().size());
    for (const Dissection::Link& link : dissection.links())
      links_[as_size(dissection.front_of()[as_size(link.from)])].push_back(link);
  }

  void run() {
    for (std::size_t f = 0; f < left_.size(); ++f) eliminate(f);
  }

 private:
  void eliminate(std::size_t f) {
    const Front& front = dissection_.fronts()[f];
    Eigen::MatrixXd& s = left_[f];
    if (s.size() == 0) s = Eigen::MatrixXd::Zero(front.rows(), front.rows());
    for (const Dissection::Link& link : links_[f]) {
      const std::int32_t a = front.row_of(link.from);
      const std::int32_t b = front.row_of(link.to);
      s(a, a) += 1.0;
      s(b, b) += 1.0;
      s(a, b) -= 1.0;
      s(b, a) -= 1.0;
    }
    tie_components(static_cast<std::int32_t>(f), s);
    const Eigen::Index p = front.pivots;
    const Eigen::Index q = front.rows() - front.pivots;
    const Eigen::MatrixXd inverse =
        s.topLeftCorner(p, p).llt().solve(Eigen::MatrixXd::Identity(p, p));
    const Eigen::MatrixXd g = -s.bottomLeftCorner(q, p) * inverse;
    if (front.parent >= 0)
      add_to_parent(front, s.bottomRightCorner(q, q) + g * s.topRightCorner(p, q));
    s.resize(0, 0);
    keep(front, inverse, g);
  }

  /// Makes the sum of x over what is left of a component count, where this front is its last one.
  /// That takes away its free constant. What rounding leaves of b's sum flows evenly to all of
  /// these nodes, and not to one of them, where it would be seen.
  void tie_components(std::int32_t f, Eigen::MatrixXd& s) const {
    const Front& front = dissection_.fronts()[as_size(f)];
    for (std::int32_t i = 0; i < front.pivots; ++i) {
      const std::int32_t component = component_[as_size(front.first + i)];
      if (last_front_[as_size(component)] != f) continue;
      for (std::int32_t j = 0; j < front.pivots; ++j)
        if (component_[as_size(front.first + j)] == component) s(i, j) += 1.0;
    }
  }

  void add_to_parent(const Front& front, const Eigen::MatrixXd& rest) {
    const Front& parent = dissection_.fronts()[as_size(front.parent)];
    Eigen::MatrixXd& s = left_[as_size(front.parent)];
    if (s.size() == 0) s = Eigen::MatrixXd::Zero(parent.rows(), parent.rows());
    std::vector<Eigen::Index> row;
    for (const std::int32_t i : front.border) row.push_back(parent.row_of(i));
    s(row, row) += rest;
  }

  /// Appends a front's block, or refers to an equal one. The border is put in the order of its
  /// places, which is the same for fronts that are alike.
  void keep(const Front& front, const Eigen::MatrixXd& inverse, const Eigen::MatrixXd& g) {
    std::vector<std::size_t> order(front.border.size());
    for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
    const auto place = [&](std::size_t i) { return place_[as_size(front.border[i])]; };
    std::sort(order.begin(), order.end(),
              [&](std::size_t a, std::size_t b) { return place(a) < place(b); });
    Block block{};
    block.first = front.first;
    block.pivots = front.pivots;
    block.border = static_cast<std::int32_t>(front.border.size());
    block.border_start = static_cast<std::int32_t>(solver_.border_.size());
    for (const std::size_t i : order) solver_.border_.push_back(front.border[i]);

    const auto p = as_size(front.pivots);
    const std::size_t q = order.size();
    std::vector<double> values(padded(q) * p + padded(p) * (p + q));
    for (std::size_t j = 0; j < p; ++j) {
      const auto pivot = static_cast<Eigen::Index>(j);
      for (std::size_t i = 0; i < q; ++i) {
        const double value = g(static_cast<Eigen::Index>(order[i]), pivot);
        values[j * padded(q) + i] = value;
        values[p * padded(q) + (p + i) * padded(p) + j] = value;
      }
      for (std::size_t i = 0; i < p; ++i)
        values[p * padded(q) + i * padded(p) + j] = inverse(pivot, static_cast<Eigen::Index>(i));
    }
    block.parent = front.parent;
    block.operations = static_cast<float>(values.size());
    block.up = place_of(front, values);
    block.down = block.up + p * padded(q);
    solver_.all_.push_back(static_cast<std::int32_t>(solver_.blocks_.size()));
    solver_.blocks_.push_back(block);
  }

  /// Returns where the values are kept.
  std::size_t place_of(const Front& front, const std::vector<double>& values) {
    std::vector<long> key{front.pivots};
    for (const double value : values) key.push_back(std::lround(value / kEqual));
    const auto [known, is_new] = known_.try_emplace(key, solver_.values_.size());
    if (is_new)
      for (const double value : values) solver_.values_.push_back(static_cast<float>(value));
    return known->second;
  }

  const Dissection& dissection_;
  BlockSolver& solver_;
  std::vector<Eigen::MatrixXd> left_;      // [fronts] what is left of A on the front
  std::vector<std::int32_t> component_;    // [nodes]
  std::vector<std::int32_t> last_front_;   // [components]
  std::vector<std::array<int, 2>> place_;  // [nodes]
  std::vector<std::vector<Dissection::Link>> links_;
  std::map<std::vector<long>, std::size_t> known_;
};

BlockSolver::BlockSolver(const Lattice& lattice, const Dissection& dissection) {
  front_of_ = dissection.front_of();
  Builder(lattice, dissection, *this).run();
}

}  // namespace curlew
