#include "reconstruct/faded_lenslets.h"

#include <algorithm>

#include "core/as_size.h"

namespace curlew {
namespace {

constexpr std::int32_t kOuterFaces = 2;  // Faces 0 and 1 lie outside the pupil.

/// Returns what a lenslet's edges add to the loops round its corners 00, 01, 10 and 11. Edge A
/// (00 → 11) runs round corner 10 in the positive sense and round corner 01 in the negative. Edge B
/// (01 → 10) does so round corners 00 and 11.
float along(const SlopeField& slopes, std::int32_t lenslet, std::size_t corner) {
  const auto k = as_size(lenslet);
  if (slopes.valid[k] == 0) return 0.0F;
  const float a = slopes.x[k] + slopes.y[k];
  const float b = slopes.y[k] - slopes.x[k];
  return std::array{b, -a, a, -b}[corner];
}

}  // namespace

PupilFaces::PupilFaces(const Lattice& lattice)
    : lattice_(lattice),
      faces_(as_size(lattice.n_faces())),
      edges_at_(as_size(lattice.n_corners())),
      component_size_(as_size(lattice.n_components())) {
  for (int corner = 0; corner < lattice.n_corners(); ++corner) {
    Face& face = faces_[as_size(lattice.face_of(corner))];
    if (face.corners++ == 0) face.corner = corner;
    const int row = corner / lattice.corner_cols();
    face.x += static_cast<float>(corner % lattice.corner_cols()) - 0.5F;
    face.y += static_cast<float>(row) - 0.5F;
    if (lattice.component_of(corner) >= 0) ++component_size_[as_size(lattice.component_of(corner))];
  }
  for (std::int32_t f = kOuterFaces; f < lattice.n_faces(); ++f)
    if (faces_[as_size(f)].corners > 1) hole_faces_.push_back(f);
  for (std::int32_t k = 0; k < lattice.rows() * lattice.cols(); ++k) {
    const auto corners = lattice.corners_of(k);
    if (lattice.phase_group_of(k) < 0) {
      if (lattice.face_of(corners[0]) >= kOuterFaces && lattice.face_of(corners[1]) >= kOuterFaces)
        missing_.push_back(k);
      continue;
    }
    lenslets_.push_back(k);
    for (std::int32_t i = 0; i < 4; ++i) {
      const int corner = corners[as_size(i)];
      ++edges_at_[as_size(corner)];
      if (lattice.hole_of_face(lattice.face_of(corner)) >= 0)
        hole_borders_.push_back({lattice.face_of(corner), k, i});
    }
  }
}

FadedLenslets::FadedLenslets(const PupilFaces& pupil)
    : faded_(pupil.lenslets().size()),
      edges_(2 * pupil.lenslets().size()),
      touched_(pupil.faces().size()),
      is_touched_(pupil.faces().size()),
      face_(pupil.faces().size()),
      hole_(pupil.faces().size()),
      loop_(pupil.faces().size()),
      sums_(pupil.faces().size()),
      gone_(pupil.edges_at().size()),
      alone_(pupil.component_size().size()) {}

std::int32_t FadedLenslets::find_root(AlignedVector<std::int32_t>& parent,
                                      std::int32_t face) noexcept {
  while (parent[as_size(face)] != face) {
    std::int32_t& next = parent[as_size(face)];
    next = parent[as_size(next)];
    face = next;
  }
  return face;
}

/// Returns false if a and b were one already. The root is always the first face.
bool FadedLenslets::unite(AlignedVector<std::int32_t>& parent, std::int32_t a,
                          std::int32_t b) noexcept {
  a = find_root(parent, a);
  b = find_root(parent, b);
  if (a == b) return false;
  parent[as_size(std::max(a, b))] = std::min(a, b);
  return true;
}

/// Makes a face ready for what it may be joined with.
void FadedLenslets::touch(std::int32_t face) noexcept {
  const auto f = as_size(face);
  if (is_touched_[f] != 0) return;
  is_touched_[f] = 1;
  touched_.push(face);
  face_[f] = hole_[f] = face;
  loop_[f] = 0.0F;
  sums_[f] = {};
}

void FadedLenslets::find(const PupilFaces& pupil, const SlopeField& slopes,
                         std::size_t n) noexcept {
  const Lattice& lattice = pupil.lattice();
  for (const std::int32_t face : touched_) is_touched_[as_size(face)] = 0;
  touched_.clear();
  faded_.clear();
  edges_.clear();
  touch(0);
  touch(1);
  for (const std::int32_t face : pupil.hole_faces()) touch(face);
  for (auto k = pupil.lenslets().begin(); faded_.size() < n; ++k)
    if (slopes.valid[as_size(*k)] == 0) faded_.push(*k);
  int bridges = 0;
  for (const std::int32_t k : faded_) {
    const auto corner = lattice.corners_of(k);
    for (const int c : corner) touch(lattice.face_of(c));
    const auto fade = [&](std::size_t from, std::size_t to, std::size_t left, std::size_t right) {
      if (unite(face_, lattice.face_of(corner[left]), lattice.face_of(corner[right])))
        edges_.push({corner[from], corner[to]});
      else
        ++bridges;
    };
    fade(0, 3, 1, 2);
    fade(1, 2, 0, 3);
  }
  count_parts(pupil, bridges);
}

/// Every bridge makes one part more. Those that are single nodes, which no lenslet touches any
/// more, do not count, nor do components of which nothing is left.
void FadedLenslets::count_parts(const PupilFaces& pupil, int bridges) noexcept {
  const Lattice& lattice = pupil.lattice();
  for (const std::int32_t k : faded_)
    for (const int corner : lattice.corners_of(k)) ++gone_[as_size(corner)];
  std::fill(alone_.begin(), alone_.end(), 0);
  int alone = 0;
  int vanished = 0;
  for (const std::int32_t k : faded_) {
    for (const int corner : lattice.corners_of(k)) {
      const auto c = as_size(corner);
      const auto component = as_size(lattice.component_of(corner));
      if (gone_[c] == pupil.edges_at()[c]) {
        ++alone;
        if (++alone_[component] == pupil.component_size()[component]) ++vanished;
      }
      gone_[c] = 0;
    }
  }
  any_part_cut_off_ = bridges != alone - vanished;
}

void FadedLenslets::join_holes(const Lattice& lattice, std::int32_t lenslet) noexcept {
  const auto corner = lattice.corners_of(lenslet);
  const std::int32_t a = find_root(face_, lattice.face_of(corner[0]));
  const std::int32_t b = find_root(face_, lattice.face_of(corner[1]));
  if (a >= kOuterFaces && b >= kOuterFaces) unite(hole_, a, b);
}

/// Returns the sum of the edges round a single corner.
float FadedLenslets::loop_round(const PupilFaces& pupil, const SlopeField& slopes,
                                std::int32_t corner) noexcept {
  const std::int32_t cols = pupil.lattice().cols();
  const std::int32_t row = corner / (cols + 1);
  const std::int32_t col = corner % (cols + 1);
  const std::int32_t k = row * cols + col;  // the lenslet whose corner 00 it is
  return along(slopes, k, 0) + along(slopes, k - 1, 1) + along(slopes, k - cols, 2) +
         along(slopes, k - cols - 1, 3);
}

void FadedLenslets::store_holes(const PupilFaces& pupil, const SlopeField& slopes,
                                FixedList<HoleCirculation>& holes) noexcept {
  const Lattice& lattice = pupil.lattice();
  holes.clear();
  for (const std::int32_t k : pupil.missing()) join_holes(lattice, k);
  for (const std::int32_t k : faded_) join_holes(lattice, k);
  for (const PupilFaces::Border& border : pupil.hole_borders())
    loop_[as_size(border.face)] += along(slopes, border.lenslet, as_size(border.corner));
  std::sort(touched_.begin(), touched_.end());
  for (const std::int32_t f : touched_) {
    const std::int32_t root = find_root(face_, f);
    if (root < kOuterFaces) continue;
    const PupilFaces::Face& face = pupil.faces()[as_size(f)];
    Sums& hole = sums_[as_size(find_root(hole_, root))];
    hole.x += face.x;
    hole.y += face.y;
    hole.corners += face.corners;
    hole.loops += face.corners > 1 ? loop_[as_size(f)] : loop_round(pupil, slopes, face.corner);
    // Edges of even corners run round a face of odd corners.
    if (root == f) ++(lattice.is_odd(face.corner) ? hole.loops_even : hole.loops_odd);
  }
  for (const std::int32_t f : touched_) {
    const Sums& hole = sums_[as_size(f)];
    if (hole.corners == 0) continue;
    const auto corners = static_cast<float>(hole.corners);
    const bool one_sublattice = hole.loops_even == 0 || hole.loops_odd == 0;
    holes.push({hole.x / corners, hole.y / corners, (one_sublattice ? 1.0F : 0.5F) * hole.loops,
                one_sublattice});
  }
}

}  // namespace curlew
