#include "core/lattice.h"

#include <algorithm>
#include <numeric>

namespace curlew {
namespace {

constexpr int kOuterEven = 0;
constexpr int kOuterOdd = 1;

}  // namespace

Lattice::Lattice(int lenslet_rows, int lenslet_cols)
    : rows_(lenslet_rows),
      cols_(lenslet_cols),
      component_(index(n_corners()), -1),
      face_(index(n_corners()), -1),
      face_size_(index(n_corners() + 2)),
      hole_of_face_(index(n_corners() + 2)),
      phase_group_(index(lenslet_rows * lenslet_cols), -1),
      holes_(index(n_corners())),
      parent_(index(n_corners() + 2)),
      label_(index(n_corners() + 2)),
      group_odd_(index(lenslet_rows * lenslet_cols)),
      group_next_(index(lenslet_rows * lenslet_cols)) {}

void Lattice::build(const Image<std::uint8_t>& valid) noexcept {
  build_parts(valid);
  label_faces(valid);
  label_holes(valid);
}

void Lattice::build_parts(const Image<std::uint8_t>& valid) noexcept {
  n_lenslets_ = static_cast<int>(
      std::count_if(valid.begin(), valid.end(), [](std::uint8_t v) { return v != 0; }));
  label_components(valid);
  label_phase_groups(valid);
}

int Lattice::find(int element) noexcept {
  while (parent_[index(element)] != element) {
    parent_[index(element)] = parent_[index(parent_[index(element)])];
    element = parent_[index(element)];
  }
  return element;
}

void Lattice::unite(int a, int b) noexcept {
  a = find(a);
  b = find(b);
  if (a == b) return;
  parent_[index(std::max(a, b))] = std::min(a, b);
}

void Lattice::label_components(const Image<std::uint8_t>& valid) noexcept {
  std::iota(parent_.begin(), parent_.end(), 0);
  std::fill(component_.begin(), component_.end(), -1);
  for (int k = 0; k < rows_ * cols_; ++k) {
    if (valid[index(k)] == 0) continue;
    const auto corner = corners_of(k);
    unite(corner[0], corner[3]);
    unite(corner[1], corner[2]);
    for (const int c : corner) component_[index(c)] = 0;
  }
  n_components_ = 0;
  n_nodes_ = 0;
  for (int c = 0; c < n_corners(); ++c) {
    if (component_[index(c)] < 0) continue;
    ++n_nodes_;
    const int root = find(c);  // A root is the smallest of its set, so it never comes after c.
    if (root == c) label_[index(c)] = n_components_++;
    component_[index(c)] = label_[index(root)];
  }
}

void Lattice::label_phase_groups(const Image<std::uint8_t>& valid) noexcept {
  std::fill(label_.begin(), label_.end(), -1);  // Here it is the first group of an even component.
  n_phase_groups_ = 0;
  for (int k = 0; k < rows_ * cols_; ++k) {
    phase_group_[index(k)] = -1;
    if (valid[index(k)] == 0) continue;
    const auto corner = corners_of(k);
    const bool odd = is_odd(corner[0]);
    const int even_component = component_of(corner[odd ? 1 : 0]);
    const int odd_component = component_of(corner[odd ? 0 : 1]);
    int group = label_[index(even_component)];
    while (group >= 0 && group_odd_[index(group)] != odd_component)
      group = group_next_[index(group)];
    if (group < 0) {
      group = n_phase_groups_++;
      group_odd_[index(group)] = odd_component;
      group_next_[index(group)] = label_[index(even_component)];
      label_[index(even_component)] = group;
    }
    phase_group_[index(k)] = group;
  }
}

void Lattice::label_faces(const Image<std::uint8_t>& valid) noexcept {
  // Elements 0 and 1 are the outsides of even and of odd corners; corner c is element c + 2.
  std::iota(parent_.begin(), parent_.end(), 0);
  for (int k = 0; k < rows_ * cols_; ++k) {
    if (valid[index(k)] != 0) continue;
    const auto corner = corners_of(k);
    unite(corner[0] + 2, corner[3] + 2);
    unite(corner[1] + 2, corner[2] + 2);
  }
  for (int c = 0; c < n_corners(); ++c) {
    const int row = c / corner_cols();
    const int col = c % corner_cols();
    if (row == 0 || row == rows_ || col == 0 || col == cols_)
      unite(c + 2, is_odd(c) ? kOuterOdd : kOuterEven);
  }
  n_faces_ = 2;
  face_size_[kOuterEven] = face_size_[kOuterOdd] = 0;
  label_[kOuterEven] = kOuterEven;
  label_[kOuterOdd] = kOuterOdd;
  for (int c = 0; c < n_corners(); ++c) {
    const int root = find(c + 2);
    if (root == c + 2) {
      label_[index(root)] = n_faces_;
      face_size_[index(n_faces_++)] = 0;
    }
    face_[index(c)] = label_[index(root)];
    ++face_size_[index(face_[index(c)])];
  }
}

void Lattice::label_holes(const Image<std::uint8_t>& valid) noexcept {
  // A missing lenslet joins the two faces it lies in, one of each sublattice, into one hole.
  std::iota(parent_.begin(), parent_.end(), 0);
  for (int k = 0; k < rows_ * cols_; ++k) {
    if (valid[index(k)] != 0) continue;
    const auto corner = corners_of(k);
    const int face_a = face_of(corner[0]);
    const int face_b = face_of(corner[1]);
    if (face_a > kOuterOdd && face_b > kOuterOdd) unite(face_a, face_b);
  }
  holes_.clear();
  std::fill(hole_of_face_.begin(), hole_of_face_.end(), -1);
  for (int face = kOuterOdd + 1; face < n_faces_; ++face) {
    if (face_size_[index(face)] == 1) continue;  // This face is a cell.
    const int root = find(face);
    if (root == face) {
      label_[index(root)] = static_cast<int>(holes_.size());
      holes_.push({});
    }
    hole_of_face_[index(face)] = label_[index(root)];
  }
  // This finds the place and the loops of each hole. Edges of even corners run round a face of odd
  // corners.
  std::fill(label_.begin(), label_.end(), 0);  // Here it counts the corners of each hole.
  for (int c = 0; c < n_corners(); ++c) {
    const int face = face_of(c);
    const int hole = hole_of_face(face);
    if (hole < 0) continue;
    LatticeHole& h = holes_[index(hole)];
    const int row = c / corner_cols();
    const int col = c % corner_cols();
    h.x += static_cast<float>(col) - 0.5F;
    h.y += static_cast<float>(row) - 0.5F;
    ++label_[index(hole)];
    if (--face_size_[index(face)] == 0) ++(is_odd(c) ? h.loops_even : h.loops_odd);
  }
  for (std::size_t hole = 0; hole < holes_.size(); ++hole) {
    holes_[hole].x /= static_cast<float>(label_[hole]);
    holes_[hole].y /= static_cast<float>(label_[hole]);
  }
}

}  // namespace curlew
