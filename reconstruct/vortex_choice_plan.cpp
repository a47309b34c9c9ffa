#include "reconstruct/vortex_choice_plan.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "core/as_size.h"

namespace curlew {
namespace {

constexpr int kOutsides = 2;  // Faces 0 and 1 lie outside the pupil.

Lattice lattice_of(const Image<std::uint8_t>& valid) {
  Lattice lattice(valid.rows(), valid.cols());
  lattice.build(valid);
  return lattice;
}

/// Returns into how many cores an axis of n lenslets is cut.
int cores(int n) {
  const int one = VortexChoicePlan::kCore + 2 * VortexChoicePlan::kMargin;
  return n <= one ? 1 : (n + VortexChoicePlan::kCore - 1) / VortexChoicePlan::kCore;
}

/// Returns the lenslets [first, last) of one core with its margin, where n lenslets are cut into
/// `parts` cores.
std::array<int, 2> span_of(int part, int parts, int n) {
  const int first = part * n / parts - VortexChoicePlan::kMargin;
  const int last = (part + 1) * n / parts + VortexChoicePlan::kMargin;
  return {std::max(first, 0), std::min(last, n)};
}

}  // namespace

ChoiceTile::ChoiceTile(int row, int col, const Image<std::uint8_t>& valid)
    : row_(row),
      col_(col),
      lattice_(lattice_of(valid)),
      factor_(make_factor()),
      unknown_(as_size(lattice_.n_corners())) {
  for (int corner = 0; corner < lattice_.n_corners(); ++corner) {
    const int face = lattice_.face_of(corner) - kOutsides;
    unknown_[as_size(corner)] = face < 0 ? -1 : factor_.position()[as_size(face)];
  }
  for (int k = 0; k < lattice_.rows() * lattice_.cols(); ++k) {
    if (lattice_.phase_group_of(k) < 0) continue;
    Lenslet lenslet{row + k / lattice_.cols(), col + k % lattice_.cols(), {}};
    const auto corner = lattice_.corners_of(k);
    for (std::size_t i = 0; i < corner.size(); ++i) lenslet.unknown[i] = unknown_of(corner[i]);
    lenslets_.push_back(lenslet);
  }
}

CholeskyFactor ChoiceTile::make_factor() const {
  const int n = lattice_.n_faces() - kOutsides;
  std::vector<Eigen::Triplet<double>> entries;
  const auto add_edge = [&](int corner_a, int corner_b) {
    const int a = lattice_.face_of(corner_a) - kOutsides;
    const int b = lattice_.face_of(corner_b) - kOutsides;
    if (a == b) return;
    if (a >= 0) entries.emplace_back(a, a, 1.0);
    if (b >= 0) entries.emplace_back(b, b, 1.0);
    if (a >= 0 && b >= 0) entries.emplace_back(std::max(a, b), std::min(a, b), -1.0);
  };
  for (int k = 0; k < lattice_.rows() * lattice_.cols(); ++k) {
    if (lattice_.phase_group_of(k) < 0) continue;
    const auto corner = lattice_.corners_of(k);
    add_edge(corner[1], corner[2]);
    add_edge(corner[0], corner[3]);
  }
  Eigen::SparseMatrix<double> a(n, n);
  a.setFromTriplets(entries.begin(), entries.end());
  return CholeskyFactor(a);
}

VortexChoicePlan::VortexChoicePlan(const Image<std::uint8_t>& valid,
                                   const VortexChoiceOptions& options, std::size_t capacity)
    : options_(options),
      capacity_(capacity),
      rows_(valid.rows()),
      cols_(valid.cols()),
      tile_rows_(cores(valid.rows())),
      tile_cols_(cores(valid.cols())) {
  for (int i = 0; i < tile_rows_; ++i) {
    for (int j = 0; j < tile_cols_; ++j) {
      const auto [top, bottom] = span_of(i, tile_rows_, rows_);
      const auto [left, right] = span_of(j, tile_cols_, cols_);
      Image<std::uint8_t> part(bottom - top, right - left);
      bool any = false;
      for (int r = top; r < bottom; ++r) {
        for (int c = left; c < right; ++c) {
          part(r - top, c - left) = valid(r, c);
          any = any || valid(r, c) != 0;
        }
      }
      tile_of_core_.push_back(any ? static_cast<std::int32_t>(tiles_.size()) : -1);
      if (any) tiles_.emplace_back(top, left, part);
    }
  }
}

std::int32_t VortexChoicePlan::tile_at(float x, float y) const {
  const auto core = [](float place, int n, int parts) {
    const int lenslet = std::clamp(static_cast<int>(std::floor(place + 0.5F)), 0, n - 1);
    return std::min(((lenslet + 1) * parts - 1) / n, parts - 1);
  };
  return tile_of_core_[as_size(core(y, rows_, tile_rows_) * tile_cols_ +
                               core(x, cols_, tile_cols_))];
}

}  // namespace curlew
