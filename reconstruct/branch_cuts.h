// Branch cuts: where a phase with vortices is torn, through the darkest lenslets.
#pragma once

#include <cstddef>
#include <cstdint>

#include "core/assignment.h"
#include "core/fixed_list.h"
#include "core/image.h"

namespace curlew {

/// A 2π jump between two neighbouring lenslets.
struct CutEdge {
  std::int32_t from = 0;  ///< lenslet k = row·cols + col; the other is k + 1 or k + cols
  std::int32_t to = 0;
  std::int32_t turns = 0;  ///< the phase jumps by 2π·turns from `from` to `to`
};

/// Buffers of one frame, made once. capacity: the most residues that are joined.
struct BranchCutWorkspace {
  BranchCutWorkspace(int rows, int cols, std::size_t capacity);

  struct Residue {
    std::int32_t cell = 0;
    std::int32_t charge = 0;
  };

  FixedList<Residue> residues;  ///< in raster order; those that did not fit are counted
  FixedList<CutEdge> cuts;      ///< as they were laid, in raster order
  double light_cut = 0;         ///< Σ over the cuts of the two lenslets' flux, ADU

  Image<std::int8_t> turns_right;  ///< [rows, cols] on the edge to the next column's lenslet
  Image<std::int8_t> turns_down;
  AlignedVector<std::int32_t> cost_right;  ///< of cutting that edge
  AlignedVector<std::int32_t> cost_down;
  AlignedVector<std::int32_t> distance;  ///< [cells] from the nearest residue or the edge
  AlignedVector<std::int32_t> owner;     ///< [cells] which: index of a residue, or their number
  AlignedVector<std::int8_t> came_by;    ///< [cells] side by which the path arrived
  AlignedVector<std::int32_t> bucket;    ///< [kBuckets] first entry
  AlignedVector<std::int32_t> next;      ///< [entries]
  AlignedVector<std::int32_t> entry_cell;
  AlignedVector<std::int32_t> entry_distance;
  Image<std::int32_t> between;  ///< [terminals, terminals] length of the shortest way found
  Image<std::int32_t> via;      ///< the first terminal on it
  Image<std::int32_t> contact;  ///< 4·cell + side, where two neighbours' regions touch
  AlignedVector<std::int32_t> positive, negative;
  Assignment assignment;
};

/// Unwraps a phase that has vortices.
///
/// wrapped: [rows, cols] rad, within [−π, π]. Differences between neighbours are taken the short
/// way round; where those round a cell of four lenslets do not add up to 0 there is a residue, ±1
/// turn. Residues are joined by cuts in opposite pairs, or with the array's edge, so that the light
/// of the lenslets on both sides of the cuts, Σ flux, is least: shortest paths over the cells from
/// all residues at once (D. Dial's buckets; costs are rounded to 1/16 of the mean flux, and cut
/// edges cost 1/16 at least so that dark ways are short), then the best pairs of all
/// (core/assignment.h; a residue is offered the 128 opposite ones at most that save most over going
/// to the edge). flux: [rows, cols], any unit, taken for 0 where valid is 0, so that cuts run
/// outside the pupil, and to its edge, free of charge.
/// unwrapped: [rows, cols], wrapped + 2π·(whole number), which differs between neighbours by less
/// than π but across cuts.
/// Residues beyond the workspace's capacity are not joined; then the phase has more jumps.
void unwrap_with_cuts(const Image<float>& wrapped, const Image<float>& flux,
                      const Image<std::uint8_t>& valid, BranchCutWorkspace& workspace,
                      Image<float>& unwrapped) noexcept;

}  // namespace curlew
