// FrameResult: the result of a frame, copied out of its slot for writers and senders.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/frame.h"
#include "core/lenslet_grid.h"
#include "core/vortex.h"
#include "service/stages.h"

namespace curlew {

struct FrameResult {
  /// capacity: the most vortices it can hold. Those beyond are counted in vortices.overflow().
  explicit FrameResult(std::size_t capacity) : vortices(capacity) {}

  /// Copies the result, once the frame's latency is complete. Never allocates.
  void copy(const FrameSlot& slot, std::int64_t frames_dropped) noexcept {
    frame_index = slot.frame_index;
    header = slot.frame->header;
    latency = slot.latency;
    grid = slot.plan->grid;
    n_valid = slot.slopes.n_valid;
    n_lost = slot.centroids.n_lost;
    n_islands = slot.split.n_islands;
    vortices.assign(slot.vortices);
    dropped = frames_dropped;
  }

  std::int64_t frame_index = 0;
  FrameHeader header;
  FrameLatency latency;
  LensletGrid grid;
  int n_valid = 0;    ///< lenslets with a slope
  int n_lost = 0;     ///< lenslets without a spot of their own
  int n_islands = 0;  ///< parts of the phase that are not connected
  VortexList vortices;
  std::vector<float> zernike;  ///< as FrameModes gives them; copy() leaves them alone
  std::int64_t dropped = 0;    ///< frames lost so far
};

}  // namespace curlew
