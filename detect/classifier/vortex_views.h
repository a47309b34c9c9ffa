// One vortex out of the views that the nodes round it have of it.
#pragma once

#include <cstddef>
#include <cstdint>

#include "core/fixed_list.h"
#include "core/image.h"
#include "core/vortex.h"

namespace curlew {

/// A vortex, or an unresolved pair (charge 0), seen from one node.
struct NodeVortex {
  Vortex vortex;
  float precision = 0;  ///< 1 / mean variance of the position; negative once reported
  std::int32_t row = 0;
  std::int32_t col = 0;
};

/// Buffers of one frame, made once.
struct VortexViews {
  VortexViews(int node_rows, int node_cols);

  /// From each node at most one of each charge, by node.
  FixedList<NodeVortex> seen;
  FixedList<std::int32_t> likely;  ///< of those seen, likely enough to be reported
  Image<std::int32_t> seen_at;  ///< [3·node rows, node cols], by charge + 1: index in seen, or −1,
                                ///< as between frames everywhere
};

/// The surest views in turn: each is reported unless a surer one is the same vortex, or was a pair
/// where this is a vortex, or the other way about. Its position is the mean of all views of it,
/// weighted by probability and precision; circulation and significance are the node's. Appends.
void report_vortices(const CirculationMap& circulation, double min_probability, VortexViews& views,
                     VortexList& vortices) noexcept;

}  // namespace curlew
