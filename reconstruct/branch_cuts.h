// This file declares branch cuts: the lines, through the darkest lenslets, along which a phase with
// vortices is torn.
#pragma once

#include <cstddef>
#include <cstdint>

#include "core/assignment.h"
#include "core/fixed_list.h"
#include "core/image.h"

namespace curlew {

/// This is a jump by a multiple of 2π between two neighbouring lenslets.
struct CutEdge {
  std::int32_t from = 0;  ///< lenslet k = row·cols + col; `to` is k + 1 or k + cols
  std::int32_t to = 0;
  std::int32_t turns = 0;  ///< the phase jumps by 2π·turns from `from` to `to`
};

/// These are the buffers of one frame, made once. At most `capacity` residues are joined.
struct BranchCutWorkspace {
  BranchCutWorkspace(int rows, int cols, std::size_t capacity);

  // A cell, between four lenslets, has the number of the first of these and cols more, as if there
  // were a row before the first. There are (rows + 1)·cols such numbers. Those of a cell before the
  // first row, or at a lenslet of the last row or column, are of no cell: they lie outside. So the
  // four round any cell are 1 and cols away.
  struct Residue {
    std::int32_t cell = 0;
    std::int32_t charge = 0;
  };

  FixedList<Residue> residues;  ///< in raster order; those that did not fit are counted
  FixedList<CutEdge> cuts;      ///< in raster order
  double light_cut = 0;         ///< sum over the cuts of the flux of their two lenslets, ADU

  Image<std::int8_t> turns_right;  ///< [rows, cols] for the edge to the next column's lenslet
  Image<std::int8_t> turns_down;
  /// [cells] what it costs to cut these two edges of a cell's first lenslet.
  AlignedVector<std::int32_t> cost_right;
  AlignedVector<std::int32_t> cost_down;
  /// [cells] to the nearest residue or the array's edge, and −1 outside.
  AlignedVector<std::int32_t> distance;
  /// [cells] index of that residue, or the number of residues for the edge and outside.
  AlignedVector<std::int32_t> owner;
  AlignedVector<std::int8_t> came_by;  ///< [cells] side by which the path arrived
  AlignedVector<std::int32_t> bucket;  ///< [kBuckets] first entry of each bucket
  AlignedVector<std::int32_t> next;    ///< [entries]
  AlignedVector<std::int32_t> entry_cell;
  AlignedVector<std::int32_t> entry_distance;
  Image<std::int32_t> between;  ///< [terminals, terminals] length of the shortest way found
  Image<std::int32_t> via;      ///< first terminal on that way
  Image<std::int32_t> contact;  ///< 4·cell + side, where two neighbours' regions touch
  AlignedVector<std::int32_t> positive, negative;
  Assignment assignment;
};

/// Unwraps a phase that has vortices.
///
/// `wrapped` is [rows, cols] in rad, within [−π, π]. Differences between neighbours are taken the
/// short way round. Where those round a cell of four lenslets do not add up to 0 there is a residue
/// of ±1 turn. Cuts join residues in opposite pairs, or join them with the array's edge, so that
/// the light of the lenslets on both sides of the cuts, Σ flux, is least. First, shortest paths
/// over the cells are found from all residues at once (R. B. Dial's buckets). Costs are rounded to
/// 1/16 of the mean flux, and a cut edge costs at least 1/16, so that ways through the dark are
/// short. Then the best set of pairs is found (core/assignment.h); a residue is offered at most 128
/// opposite ones, those that save most over going to the edge.
///
/// `flux` is [rows, cols] in any unit. It is taken for 0 where `valid` is 0, so that cuts outside
/// the pupil, and to its edge, cost almost nothing. `unwrapped` is [rows, cols] and holds wrapped +
/// 2π·(whole number). It differs between neighbours by less than π, except across cuts. Residues
/// beyond the workspace's capacity are not joined; then the phase has more jumps.
void unwrap_with_cuts(const Image<float>& wrapped, const Image<float>& flux,
                      const Image<std::uint8_t>& valid, BranchCutWorkspace& workspace,
                      Image<float>& unwrapped) noexcept;

}  // namespace curlew
