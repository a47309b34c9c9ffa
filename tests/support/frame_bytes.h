#pragma once

#include <cstddef>
#include <vector>

#include "core/frame.h"

namespace curlew {

inline std::vector<std::byte> bytes_of(const FrameBuffer& buffer, const FrameFormat& format) {
  return {buffer.view().pixels, buffer.view().pixels + format.bytes()};
}

}  // namespace curlew
