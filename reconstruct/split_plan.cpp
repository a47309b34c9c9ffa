#include <algorithm>
#include <deque>
#include <string>

#include "core/as_size.h"
#include "core/error.h"
#include "core/memory_limit.h"
#include "reconstruct/split.h"

namespace curlew {
namespace {

/// Returns the map, if the plan for it can be made within the limit on memory.
const Image<std::uint8_t>& affordable(const Image<std::uint8_t>& valid) {
  constexpr double kLenslet_bytes = 1600.0;  // measured on 400 x 400 of them
  require_memory("splitting the slopes of " + std::to_string(valid.rows()) + " x " +
                     std::to_string(valid.cols()) + " lenslets",
                 kLenslet_bytes * static_cast<double>(valid.size()));
  return valid;
}

Lattice lattice_of(const Image<std::uint8_t>& valid) {
  if (std::none_of(valid.begin(), valid.end(), [](std::uint8_t v) { return v != 0; }))
    throw Failure("reconstruct: the sensor has no lit lenslet, calibrate it again");
  Lattice lattice(valid.rows(), valid.cols());
  lattice.build(valid);
  return lattice;
}

/// Returns the lenslets with their nodes numbered. The pinned nodes, which are the first of every
/// component, come last.
std::vector<SplitPlan::Lenslet> number_unknowns(const Lattice& lattice) {
  std::vector<int> unknown(as_size(lattice.n_corners()), -1);
  std::vector<bool> pinned(as_size(lattice.n_components()), false);
  int next = 0;
  int next_pinned = lattice.n_nodes() - lattice.n_components();
  for (int corner = 0; corner < lattice.n_corners(); ++corner) {
    const int component = lattice.component_of(corner);
    if (component < 0) continue;
    unknown[as_size(corner)] = pinned[as_size(component)] ? next++ : next_pinned++;
    pinned[as_size(component)] = true;
  }
  std::vector<SplitPlan::Lenslet> lenslets;
  for (int k = 0; k < lattice.rows() * lattice.cols(); ++k) {
    if (lattice.phase_group_of(k) < 0) continue;
    SplitPlan::Lenslet lenslet{k, {}};
    const auto corners = lattice.corners_of(k);
    for (std::size_t i = 0; i < corners.size(); ++i) lenslet.node[i] = unknown[as_size(corners[i])];
    lenslets.push_back(lenslet);
  }
  return lenslets;
}

}  // namespace

SplitPlan::SplitPlan(const Image<std::uint8_t>& valid, const SplitOptions& options)
    : options_(options),
      lattice_(lattice_of(affordable(valid))),
      lenslets_(number_unknowns(lattice_)),
      factor_(laplacian()) {
  // The numbers change from the order of the corners to the order of elimination. Pinned nodes keep
  // their places at the end.
  for (Lenslet& lenslet : lenslets_)
    for (std::int32_t& node : lenslet.node)
      if (node < factor_.size()) node = factor_.position()[as_size(node)];
  plan_potential();
  plan_hole_borders();
}

Eigen::SparseMatrix<double> SplitPlan::laplacian() const {
  const int n = lattice_.n_nodes() - lattice_.n_components();
  std::vector<Eigen::Triplet<double>> entries;
  const auto add_edge = [&](int a, int b) {
    if (a < n) entries.emplace_back(a, a, 1.0);
    if (b < n) entries.emplace_back(b, b, 1.0);
    if (a < n && b < n) entries.emplace_back(std::max(a, b), std::min(a, b), -1.0);
  };
  for (const Lenslet& lenslet : lenslets_) {
    add_edge(lenslet.node[0], lenslet.node[3]);
    add_edge(lenslet.node[1], lenslet.node[2]);
  }
  Eigen::SparseMatrix<double> a(n, n);
  a.setFromTriplets(entries.begin(), entries.end());
  return a;
}

/// Walks over the faces breadth first from the outer ones, where ψ is 0.
void SplitPlan::plan_potential() {
  struct Crossing {
    int to;
    int edge;
    float sign;
  };
  std::vector<std::vector<Crossing>> crossings(as_size(lattice_.n_faces()));
  for (std::size_t m = 0; m < lenslets_.size(); ++m) {
    const auto corner = lattice_.corners_of(lenslets_[m].k);
    // w·eA = ψ(01) − ψ(10) and w·eB = ψ(11) − ψ(00): ψ changes along the edges turned by 90°.
    const auto add = [&](int plus, int minus, int edge) {
      const int face_plus = lattice_.face_of(plus);
      const int face_minus = lattice_.face_of(minus);
      crossings[as_size(face_minus)].push_back({face_plus, edge, 1.0F});
      crossings[as_size(face_plus)].push_back({face_minus, edge, -1.0F});
    };
    add(corner[1], corner[2], 2 * static_cast<int>(m));
    add(corner[3], corner[0], 2 * static_cast<int>(m) + 1);
  }
  std::vector<bool> seen(as_size(lattice_.n_faces()), false);
  std::deque<int> queue{0, 1};
  seen[0] = seen[1] = true;
  while (!queue.empty()) {
    const int face = queue.front();
    queue.pop_front();
    for (const Crossing& crossing : crossings[as_size(face)]) {
      if (seen[as_size(crossing.to)]) continue;
      seen[as_size(crossing.to)] = true;
      potential_steps_.push_back({crossing.to, face, crossing.edge, crossing.sign});
      queue.push_back(crossing.to);
    }
  }
}

void SplitPlan::plan_hole_borders() {
  for (std::size_t m = 0; m < lenslets_.size(); ++m) {
    const auto corner = lattice_.corners_of(lenslets_[m].k);
    if (std::any_of(corner.begin(), corner.end(),
                    [&](int c) { return lattice_.hole_of_face(lattice_.face_of(c)) >= 0; }))
      hole_borders_.push_back(static_cast<std::int32_t>(m));
  }
}

}  // namespace curlew
