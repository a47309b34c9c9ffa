// FrameSample is a copy of one frame as it came.
#pragma once

#include <cstddef>
#include <cstring>

#include "core/frame.h"
#include "core/image.h"
#include "service/stages.h"

namespace curlew {

/// As AskedCopy asks for.
struct FrameSample {
  bool copy(const FrameSlot& slot) noexcept {
    format = slot.frame->format();
    header = slot.frame->header;
    if (pixels.size() != format.bytes()) return false;
    std::memcpy(pixels.data(), slot.frame->view().pixels, pixels.size());
    return true;
  }
  void fit() { pixels.resize(format.bytes()); }

  FrameFormat format;
  FrameHeader header;
  AlignedVector<std::byte> pixels;
};

}  // namespace curlew
