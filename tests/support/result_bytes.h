// The results of a frame as bytes, for tests that ask whether two ways give the same bits.
#pragma once

#include <cstddef>
#include <string>

#include "service/stages.h"

namespace curlew {

inline std::string result_bytes(const FrameSlot& slot) {
  std::string bytes;
  const auto add = [&](const void* data, std::size_t size) {
    bytes.append(static_cast<const char*>(data), size);
  };
  add(&slot.frame_index, sizeof slot.frame_index);
  add(&slot.frame->header.status, sizeof slot.frame->header.status);
  add(&slot.follow_state, sizeof slot.follow_state);
  add(&slot.centroids.n_valid, sizeof slot.centroids.n_valid);
  add(&slot.centroids.n_lost, sizeof slot.centroids.n_lost);
  add(&slot.slopes.n_valid, sizeof slot.slopes.n_valid);
  add(&slot.weak_slopes.n_valid, sizeof slot.weak_slopes.n_valid);
  add(&slot.circulation.n_valid, sizeof slot.circulation.n_valid);
  for (const Vortex& v : slot.vortices) add(&v, sizeof v);
  add(slot.centroids.state.data(), slot.centroids.state.size());
  add(slot.circulation.valid.data(), slot.circulation.valid.size());
  for (const Image<float>* image :
       {&slot.centroids.x_px, &slot.centroids.y_px, &slot.centroids.flux_adu,
        &slot.centroids.low_x_px, &slot.centroids.moved_x_px, &slot.slopes.x, &slot.slopes.y,
        &slot.slopes.variance_x, &slot.weak_slopes.x, &slot.weak_slopes.variance_y,
        &slot.circulation.value, &slot.circulation.variance, &slot.split.phase,
        &slot.split.solenoidal_x})
    add(image->data(), image->size() * sizeof(float));
  return bytes;
}

}  // namespace curlew
