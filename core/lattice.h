// A Lattice holds the nodes, edges, cells, holes and components of a pupil, made from the mask of
// its lenslets.
//
// The lenslets' corners are the nodes (Fried's geometry). Corner (i, j) lies at (j − ½, i − ½) in
// lenslet units. A lenslet with corners 00, 01, 10, 11 (row, col) is two edges, its diagonals:
//   edge A: 00 → 11 carries s_x + s_y = φ11 − φ00,
//   edge B: 01 → 10 carries s_y − s_x = φ10 − φ01.
// Every edge joins corners of one parity (i + j even, or odd), so there are two sublattices. The
// edges of one sublattice separate corners of the other, which are therefore the faces of the
// first: a corner between four lenslets is a cell, corners joined through missing lenslets are the
// face of a hole, and all corners joined to the outside are the outer face.
#pragma once

#include <array>
#include <cstdint>

#include "core/fixed_list.h"
#include "core/image.h"

namespace curlew {

/// Describes one hole of the pupil: missing lenslets that other lenslets surround. A hole that
/// touches the rim, or another gap, by a corner may have a loop on one sublattice only.
struct LatticeHole {
  float x = 0;  ///< mean place of the corners in its faces, lenslet units
  float y = 0;
  int loops_even = 0;  ///< number of loops along edges of even corners
  int loops_odd = 0;   ///< number of loops along edges of odd corners
};

/// The constructor makes all buffers and build() allocates nothing, so that a frame whose lenslets
/// have faded can have a lattice of its own.
class Lattice {
 public:
  Lattice(int lenslet_rows, int lenslet_cols);

  /// Builds the lattice. valid: [rows, cols], non-zero where a lenslet takes part.
  void build(const Image<std::uint8_t>& valid) noexcept;
  /// Builds components and phase groups only, in half the time. Faces and holes mean nothing then.
  void build_parts(const Image<std::uint8_t>& valid) noexcept;

  int rows() const { return rows_; }
  int cols() const { return cols_; }
  int corner_cols() const { return cols_ + 1; }
  int n_corners() const { return (rows_ + 1) * (cols_ + 1); }
  int n_lenslets() const { return n_lenslets_; }

  /// Returns the four corners 00, 01, 10, 11 of a lenslet.
  std::array<int, 4> corners_of(int lenslet) const {
    const int corner = lenslet / cols_ * corner_cols() + lenslet % cols_;
    return {corner, corner + 1, corner + corner_cols(), corner + corner_cols() + 1};
  }
  bool is_odd(int corner) const {
    return (corner / corner_cols() + corner % corner_cols()) % 2 != 0;
  }

  /// Returns the connected component of a corner as a node, −1 if no valid lenslet touches it.
  /// Components are numbered through both sublattices.
  int component_of(int corner) const { return component_[index(corner)]; }
  int n_components() const { return n_components_; }
  int n_nodes() const { return n_nodes_; }

  /// Returns the face that a corner, as seen from the other sublattice, belongs to. Faces 0 and 1
  /// are the outer ones, of even corners and of odd corners.
  int face_of(int corner) const { return face_[index(corner)]; }
  int n_faces() const { return n_faces_; }

  /// Returns the hole of a face, −1 for cells and for the outer faces.
  int hole_of_face(int face) const { return hole_of_face_[index(face)]; }
  const FixedList<LatticeHole>& holes() const { return holes_; }

  /// Returns the phase group of a lenslet, −1 if the lenslet is not valid. Lenslets with the same
  /// pair of (even, odd) components are one group: their phases share one free constant.
  int phase_group_of(int lenslet) const { return phase_group_[index(lenslet)]; }
  int n_phase_groups() const { return n_phase_groups_; }

 private:
  static std::size_t index(int i) { return static_cast<std::size_t>(i); }
  int find(int element) noexcept;
  void unite(int a, int b) noexcept;
  void label_components(const Image<std::uint8_t>& valid) noexcept;
  void label_phase_groups(const Image<std::uint8_t>& valid) noexcept;
  void label_faces(const Image<std::uint8_t>& valid) noexcept;
  void label_holes(const Image<std::uint8_t>& valid) noexcept;

  int rows_;
  int cols_;
  int n_lenslets_ = 0;
  int n_nodes_ = 0;
  int n_components_ = 0;
  int n_faces_ = 0;
  int n_phase_groups_ = 0;
  AlignedVector<int> component_;     // [corners]
  AlignedVector<int> face_;          // [corners]
  AlignedVector<int> face_size_;     // [faces] number of corners
  AlignedVector<int> hole_of_face_;  // [faces]
  AlignedVector<int> phase_group_;   // [lenslets]
  FixedList<LatticeHole> holes_;

  AlignedVector<int> parent_;      // union-find forest over corners, the two outsides, or faces
  AlignedVector<int> label_;       // label of each root
  AlignedVector<int> group_odd_;   // [groups] odd component of a phase group
  AlignedVector<int> group_next_;  // [groups] next group of the same even component
};

}  // namespace curlew
