// This file declares what lenslets that fade in a frame do to the pupil: which of its parts fall
// apart, and which holes open.
//
// A lenslet that fades takes away two edges, one of each sublattice. An edge has a face on either
// side (core/lattice.h). Where these are two faces, they become one, and the edge's ends stay
// connected by another way. Where both sides are one face already, nothing else connects the ends:
// the edge is a bridge. So it is enough to join faces, beginning from those of the whole pupil, and
// the time that it takes grows with the number of lenslets that have faded.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "core/fixed_list.h"
#include "core/hodge_split.h"
#include "core/lattice.h"
#include "core/slope_field.h"

namespace curlew {

/// The faces and nodes of the whole pupil. It is const after construction and shared by threads.
class PupilFaces {
 public:
  explicit PupilFaces(const Lattice& lattice);

  struct Face {
    std::int32_t corner = 0;   ///< the first of its corners
    std::int32_t corners = 0;  ///< how many it has
    float x = 0;               ///< sum over its corners, lenslet units
    float y = 0;
  };
  /// This is a lenslet's edge that runs round a face of more than one corner.
  struct Border {
    std::int32_t face;
    std::int32_t lenslet;
    std::int32_t corner;  ///< which of the lenslet's corners lies in the face, 0 to 3
  };

  const Lattice& lattice() const { return lattice_; }
  const std::vector<std::int32_t>& lenslets() const { return lenslets_; }  ///< all lit ones
  const std::vector<Face>& faces() const { return faces_; }
  const std::vector<std::int32_t>& hole_faces() const { return hole_faces_; }  ///< ascending
  const std::vector<Border>& hole_borders() const { return hole_borders_; }
  /// Returns the missing lenslets that lie in holes only.
  const std::vector<std::int32_t>& missing() const { return missing_; }
  /// Returns how many edges end at each corner, and how many nodes each component has.
  const std::vector<std::int8_t>& edges_at() const { return edges_at_; }
  const std::vector<std::int32_t>& component_size() const { return component_size_; }

 private:
  Lattice lattice_;
  std::vector<std::int32_t> lenslets_;
  std::vector<Face> faces_;
  std::vector<std::int32_t> hole_faces_;
  std::vector<Border> hole_borders_;
  std::vector<std::int32_t> missing_;
  std::vector<std::int8_t> edges_at_;
  std::vector<std::int32_t> component_size_;
};

/// This belongs to one frame. The constructor makes all buffers.
class FadedLenslets {
 public:
  explicit FadedLenslets(const PupilFaces& pupil);

  /// This is an edge that has faded and that was no bridge, by its corners.
  struct Edge {
    std::int32_t from;
    std::int32_t to;
  };

  /// Finds the n lenslets of the pupil that are not valid in `slopes`, and what follows.
  void find(const PupilFaces& pupil, const SlopeField& slopes, std::size_t n) noexcept;

  const FixedList<std::int32_t>& lenslets() const { return faded_; }
  const FixedList<Edge>& edges() const { return edges_; }
  /// Returns whether a part of more than one node has been cut off from another such part.
  bool any_part_cut_off() const { return any_part_cut_off_; }

  /// Stores the holes of the frame, in the order of their first corners, with their circulation.
  void store_holes(const PupilFaces& pupil, const SlopeField& slopes,
                   FixedList<HoleCirculation>& holes) noexcept;

 private:
  static std::int32_t find_root(AlignedVector<std::int32_t>& parent, std::int32_t face) noexcept;
  static bool unite(AlignedVector<std::int32_t>& parent, std::int32_t a, std::int32_t b) noexcept;
  void touch(std::int32_t face) noexcept;
  void join_holes(const Lattice& lattice, std::int32_t lenslet) noexcept;
  void count_parts(const PupilFaces& pupil, int bridges) noexcept;
  static float loop_round(const PupilFaces& pupil, const SlopeField& slopes,
                          std::int32_t corner) noexcept;

  /// This is a hole while it is added up.
  struct Sums {
    float x, y, loops;
    std::int32_t corners, loops_even, loops_odd;
  };

  FixedList<std::int32_t> faded_;
  FixedList<Edge> edges_;
  bool any_part_cut_off_ = false;
  FixedList<std::int32_t> touched_;         // faces, each once
  AlignedVector<std::uint8_t> is_touched_;  // [faces]
  AlignedVector<std::int32_t> face_;        // [faces] forest of faces that are one
  AlignedVector<std::int32_t> hole_;        // [faces] forest of faces of one hole
  AlignedVector<float> loop_;               // [faces] sum of the edges round it
  AlignedVector<Sums> sums_;                // [faces]
  AlignedVector<std::int8_t> gone_;         // [corners] edges that have faded
  AlignedVector<std::int32_t> alone_;       // [components] nodes without an edge
};

}  // namespace curlew
