// A PageSource has the frames that the page shows: those of a camera, or those of a replay.
#pragma once

#include <chrono>
#include <cstdint>
#include <string>

#include "service/page/page_message.h"

namespace curlew {

class PageSource {
 public:
  virtual ~PageSource() = default;

  /// Returns what the page asks first: JSON that says "mode":"live" or "mode":"replay", and in a
  /// replay how many frames are there.
  virtual std::string status() = 0;

  /// Returns the description of a plan; null if there is none of this number.
  virtual PageMessage sensor(std::int64_t plan) = 0;

  /// Returns the frame of this number (replay), or the next one after this number (live); null if
  /// it is not there yet. waited: how long the page has been waiting.
  virtual PageMessage frame(std::int64_t number, std::chrono::milliseconds waited) = 0;

  /// Returns how long a connection waits from one answer of this source to the next.
  virtual std::chrono::milliseconds between_frames() const { return {}; }
};

}  // namespace curlew
