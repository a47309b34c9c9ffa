// This file declares how the views that several nodes have of one vortex are merged into one.
#pragma once

#include <cstddef>
#include <cstdint>

#include "core/fixed_list.h"
#include "core/image.h"
#include "core/vortex.h"

namespace curlew {

/// This is a view: a vortex, or an unresolved pair (charge 0), seen from one node.
struct NodeVortex {
  Vortex vortex;
  float precision = 0;  ///< 1/(mean variance of the position)
  std::int32_t row = 0;
  std::int32_t col = 0;
};

/// These are the buffers of one frame, made once.
struct VortexViews {
  VortexViews(int node_rows, int node_cols);

  /// The views are in the order of the nodes. A node has at most one of each charge.
  FixedList<NodeVortex> seen;
  FixedList<std::uint64_t> likely;  ///< keys of the views that are likely enough to be reported
  Image<std::int32_t> seen_at;  ///< [3·node rows, node cols], by charge + 1: the index in `seen`
  /// These say in the same rows, one bit a node, whether there is a view, and whether it has been
  /// reported. A row has two unused bits before its first node and an unused word at its end, so
  /// that the bits round any node can be read. Between frames all are 0.
  Image<std::uint64_t> is_seen;
  Image<std::uint64_t> is_reported;
};

/// Reports the surest views one after the other, and appends them to `vortices`. A view is not
/// reported if a surer one is the same vortex, nor if a surer one is a pair where this is a vortex,
/// or a vortex where this is a pair. The position is the mean of all views of the vortex, weighted
/// by probability and precision. Circulation and significance are the node's.
void report_vortices(const CirculationMap& circulation, double min_probability, VortexViews& views,
                     VortexList& vortices) noexcept;

}  // namespace curlew
