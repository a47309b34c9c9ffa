#include <algorithm>
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

}  // namespace

SplitPlan::SplitPlan(const Image<std::uint8_t>& valid, const SplitOptions& options)
    : SplitPlan(options, lattice_of(affordable(valid))) {}

SplitPlan::SplitPlan(const SplitOptions& options, const Lattice& lattice)
    : SplitPlan(options, lattice, Dissection(lattice)) {}

SplitPlan::SplitPlan(const SplitOptions& options, const Lattice& lattice,
                     const Dissection& dissection)
    : options_(options),
      faces_(lattice),
      grid_(lattice.rows(), lattice.cols()),
      solver_(lattice, dissection),
      network_(dissection, grid_),
      lit_(grid_.size()),
      from_left_(grid_.size()),
      from_right_(grid_.size()) {
  for (const std::int32_t k : lenslets()) lit_[grid_.lenslet(k)] = 1.0F;
  node_of_corner_.resize(as_size(lattice.n_corners()));
  for (int i = 0; i < dissection.n_nodes(); ++i) {
    const int corner = dissection.corner_at(i);
    node_of_corner_[as_size(corner)] = i;
    node_places_.push_back(
        grid_.at(corner / lattice.corner_cols(), corner % lattice.corner_cols()));
  }
  plan_potential();
}

/// ψ is 0 on the outer faces. From there it follows downwards, across the lenslet at the upper left
/// of a corner, or across the one at the upper right. A corner of a hole's face that has neither
/// gets the ψ of that face's first corner, which has both.
void SplitPlan::plan_potential() {
  std::vector<std::size_t> first_of_face(as_size(lattice().n_faces()), 0);
  for (int row = 0; row <= grid_.rows; ++row) {
    for (int col = 0; col <= grid_.cols; ++col) {
      const int face = lattice().face_of(row * lattice().corner_cols() + col);
      if (face < 2) continue;
      const std::size_t at = grid_.at(row, col);
      std::size_t& first = first_of_face[as_size(face)];
      if (lit_[at - grid_.stride - 1] > 0.0F) {
        from_left_[at] = 1.0F;
      } else if (lit_[at - grid_.stride] > 0.0F) {
        from_right_[at] = 1.0F;
      } else {
        potential_copies_.push_back({row, at, first});
      }
      if (first == 0) first = at;
    }
  }
}

}  // namespace curlew
