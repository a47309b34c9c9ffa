// A NetworkFactor factorises the Laplacian of one frame's weights, and solves with it.
//
// The lenslets' edges are conductances between nodes. Eliminating a node joins each two of its
// neighbours i and k by the conductance a_i·a_k/Σa (the star-mesh transform), which is Cholesky's
// step for a Laplacian. The pivot is the sum of what is off the diagonal, as W. K. Grassmann, M. I.
// Taksar and D. P. Heyman compute it (Oper. Res. 33, 1107, 1985). Nothing is ever subtracted, so
// that the factor is accurate however much the weights differ, and the pivot of a component's last
// node is exactly 0: pieces that faded lenslets cut off need no special case.
//
// Tiles are eliminated 16 at a time, each in one lane of the vectors, by one list of steps. Fronts
// on lines are dense and are eliminated one after the other, in vectors down their columns.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/image.h"
#include "reconstruct/dissection.h"
#include "reconstruct/split_grid.h"

namespace curlew {

class NetworkFactor {
 public:
  static constexpr int kLanes = 16;  ///< tiles that are eliminated side by side

  NetworkFactor(const Dissection& dissection, const SplitGrid& grid);

  /// This is the factor of one frame, and scratch memory.
  struct Workspace {
    explicit Workspace(const NetworkFactor& factor);
    AlignedVector<float> tiles;        ///< [batches, entries, lanes] columns of L
    AlignedVector<float> tile_scales;  ///< [batches, nodes inside, lanes] 1/√pivot
    AlignedVector<float> rests;        ///< [batches, border pairs, lanes] what tiles leave
    AlignedVector<float> panels;       ///< columns of L of the fronts on lines
    AlignedVector<float> scales;       ///< [nodes] 1/√pivot; 0 of a component's last node
    AlignedVector<float> fronts;       ///< what fronts on lines leave, while it is needed
    AlignedVector<float> vector;       ///< a front's part of b
  };

  /// Factorises the Laplacian of the weights, which are [grid] and not negative.
  void factorise(const float* weight, Workspace& workspace) const noexcept;

  /// Computes b ← A⁻¹·b with the factor in the workspace, where the last node of every component is
  /// 0. b is [n_nodes + 1] in the order of elimination, and its last element is 0.
  void solve(Workspace& workspace, float* b) const noexcept;

  /// Returns about how long a factorisation and a refined solution take, ns. Fitted to 40×40,
  /// 80×80 and 160×160 lenslets.
  double predict_ns() const {
    constexpr double kOperationNs = 0.055;
    constexpr double kNodeNs = 34.0;
    return kOperationNs * operations_ + kNodeNs * static_cast<double>(steps_.nodes);
  }

  // What follows are the steps, which network_factor.cpp and network_solver.cpp carry out.

  /// This is a node inside a tile: its column begins at `first` and has `size` entries.
  struct TilePivot {
    std::int32_t first;
    std::int32_t size;
    std::int32_t target;  ///< where its targets begin
  };
  /// This is a tile's border node, by its number among them, and its row in the parent front.
  struct BorderRow {
    std::int32_t node;
    std::int32_t row;
  };
  /// This says where a tile's rest goes: rows [first, last) of border_rows(), ascending.
  struct TileRest {
    std::int32_t tile;
    std::int32_t first;
    std::int32_t last;
  };
  /// This is a weight that is added to one place of a front.
  struct FrontLink {
    std::int32_t place;
    std::int32_t weight;
  };
  /// These are rows of a child that lie side by side in its parent, too.
  struct Run {
    std::int32_t from;
    std::int32_t to;
    std::int32_t size;
  };
  struct Child {
    std::int32_t line;  ///< index of its LineFront
    std::int32_t first_run, last_run;
    std::int32_t first_row;  ///< its border's rows in the parent begin here in child_rows
  };
  struct LineFront {
    std::int32_t first, pivots, border;
    std::int32_t stride;  ///< of a column, in floats; a multiple of 16
    std::size_t panel;    ///< where its pivots' columns begin
    std::size_t rest;     ///< where its border's columns begin
    std::int32_t first_border;
    std::int32_t first_tile, last_tile;
    std::int32_t first_child, last_child;
    std::int32_t first_link, last_link;
  };
  struct Steps {
    std::int32_t nodes = 0;
    std::int32_t batches = 0;
    std::int32_t entries = 0;  ///< of L in one tile
    std::array<TilePivot, TileShape::kInside> pivots;
    std::vector<std::int32_t> entry_row;   ///< [entries] node of the tile
    std::vector<std::int32_t> targets;     ///< entries, or from `entries` on, pairs of the border
    std::vector<std::int32_t> edge_entry;  ///< [edges of a tile]
    std::array<std::array<std::int32_t, TileShape::kBorder>, TileShape::kBorder> pair;
    AlignedVector<std::int32_t> edge_weight;    ///< [batches, edges, lanes] place in the grid
    AlignedVector<std::int32_t> tile_position;  ///< [batches, nodes of a tile, lanes]
    std::vector<LineFront> lines;
    std::vector<TileRest> tile_rests;
    std::vector<BorderRow> border_rows;
    std::vector<Child> children;
    std::vector<Run> runs;
    std::vector<std::int32_t> child_rows;
    std::vector<FrontLink> links;
    std::vector<std::int32_t> borders;
    std::size_t panel_size = 0;
    std::size_t rest_size = 0;
    std::int32_t longest = 0;  ///< stride of the largest front
  };
  const Steps& steps() const { return steps_; }

 private:
  void plan_tile(const TileShape& shape);
  void plan_batches(const Dissection& dissection, const SplitGrid& grid);
  void plan_lines(const Dissection& dissection, const SplitGrid& grid);
  void plan_children(const Dissection& dissection, const std::vector<std::int32_t>& line_of);
  void plan_rests();

  Steps steps_;
  double operations_ = 0.0;  // multiplications of a factorisation
};

}  // namespace curlew
