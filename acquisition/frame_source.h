// FrameSource: where frames come from. A recording, the simulator, a camera.
#pragma once

#include <cstdint>

#include "core/frame.h"

namespace curlew {

enum class Delivery {
  kFrame,  ///< `into` holds the next frame
  kEnd,    ///< there are no more
};

class FrameSource {
 public:
  virtual ~FrameSource() = default;

  virtual const FrameFormat& format() const = 0;

  /// How many frames there will be; −1 where nobody knows.
  virtual std::int64_t frame_count() const = 0;

  /// Fills pixels, header and rows_ready. Throws Failure when the source fails.
  virtual Delivery next(FrameBuffer& into) = 0;
};

}  // namespace curlew
