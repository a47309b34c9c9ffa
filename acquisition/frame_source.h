// A FrameSource gives frames when it is asked for them, as a recording and the simulator do.
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

  /// Returns how many frames there will be, −1 if nobody knows.
  virtual std::int64_t frame_count() const = 0;

  /// Fills pixels, header and rows_ready of `into`. Throws Failure when the source fails.
  virtual Delivery next(FrameBuffer& into) = 0;
};

}  // namespace curlew
