// Camera: a device that sends frames by itself.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "core/error.h"
#include "core/frame.h"
#include "core/frame_exchange.h"
#include "core/optics.h"

namespace curlew {

/// What became of the frames of a camera. By its own numbering every frame is in exactly one:
/// last − first + 1 = delivered + incomplete + timed_out + aborted + wrong_size + other + lost.
struct FrameCounts {
  std::int64_t delivered = 0;   ///< whole, given to the exchange
  std::int64_t incomplete = 0;  ///< packets or bytes missing
  std::int64_t timed_out = 0;   ///< its end never came
  std::int64_t aborted = 0;     ///< the stream stopped in the middle of it
  std::int64_t wrong_size = 0;  ///< more or fewer pixels than agreed
  std::int64_t other = 0;       ///< any other status that is not success
  std::int64_t lost = 0;        ///< numbers that never came
  std::int64_t no_buffer = 0;   ///< of those lost: we had no buffer free

  FrameCounts& operator+=(const FrameCounts& more) {
    delivered += more.delivered;
    incomplete += more.incomplete;
    timed_out += more.timed_out;
    aborted += more.aborted;
    wrong_size += more.wrong_size;
    other += more.other;
    lost += more.lost;
    no_buffer += more.no_buffer;
    return *this;
  }
  /// All that were not delivered.
  std::int64_t dropped() const {
    return incomplete + timed_out + aborted + wrong_size + other + lost;
  }
};

class Camera {
 public:
  virtual ~Camera() = default;

  virtual const FrameFormat& format() const = 0;

  /// What is attached, for people: vendor, model, serial number, address.
  virtual std::string description() const = 0;

  /// Sentences on what the camera does otherwise than it was told, and on what it sends.
  virtual std::vector<std::string> notes() const = 0;

  /// What the source tells of optics and detector, as recordings and the simulator do.
  virtual Optics optics() const { return {}; }
  virtual Detector detector() const { return {}; }

  /// Sends frames to the exchange, from a thread of its own, until stop(). Each header is complete,
  /// sequence counts on through wraps of the device's numbers, and the first is `renumbered`.
  /// Failure names the device. Where the camera dies or ends it closes the exchange.
  virtual void start(FrameExchange& exchange) = 0;

  /// When it returns nothing of the camera touches the exchange any more, and counts() is final.
  /// Works on a dead camera too, within a second or so.
  virtual void stop() noexcept = 0;

  /// Starts a frame where the trigger is software. Failure where it is not.
  virtual void trigger() {
    throw Failure(description().append(" takes no software trigger, set trigger = \"software\""));
  }

  /// Why it closed the exchange; empty while it is well, and where it came to its natural end.
  virtual std::string failure() const = 0;

  virtual FrameCounts counts() const = 0;
};

/// The camera streams into the exchange as long as this lives.
class Streaming {
 public:
  Streaming(Camera& camera, FrameExchange& exchange) : camera_(camera) { camera.start(exchange); }
  ~Streaming() { camera_.stop(); }
  Streaming(const Streaming&) = delete;
  Streaming& operator=(const Streaming&) = delete;

 private:
  Camera& camera_;
};

/// Called once in every thread in which a camera takes frames, before the first: pinning, priority.
using ThreadStart = std::function<void()>;

}  // namespace curlew
