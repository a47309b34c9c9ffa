// A Camera is a device that sends frames by itself.
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

/// Counts what became of the frames of a camera. By the camera's own numbering every frame is in
/// exactly one of the counts down to `lost`: last − first + 1 = delivered + incomplete + timed_out
/// + aborted + wrong_size + other + lost.
struct FrameCounts {
  std::int64_t delivered = 0;   ///< frames that came whole and went to the exchange
  std::int64_t incomplete = 0;  ///< frames with packets or bytes missing
  std::int64_t timed_out = 0;   ///< frames whose end never came
  std::int64_t aborted = 0;     ///< frames in the middle of which the stream stopped
  std::int64_t wrong_size = 0;  ///< frames with more or fewer pixels than agreed
  std::int64_t other = 0;       ///< frames with any other status that is not success
  std::int64_t lost = 0;        ///< frames whose numbers never came
  std::int64_t no_buffer = 0;   ///< those lost frames for which no buffer was free
  /// Packets that a network camera's socket refused, because others sent them or they were
  /// malformed, or for want of room. They are no frames.
  std::int64_t refused_packets = 0;

  FrameCounts& operator+=(const FrameCounts& more) {
    delivered += more.delivered;
    incomplete += more.incomplete;
    timed_out += more.timed_out;
    aborted += more.aborted;
    wrong_size += more.wrong_size;
    other += more.other;
    lost += more.lost;
    no_buffer += more.no_buffer;
    refused_packets += more.refused_packets;
    return *this;
  }
  /// Returns how many frames were not delivered.
  std::int64_t dropped() const {
    return incomplete + timed_out + aborted + wrong_size + other + lost;
  }
};

class Camera {
 public:
  virtual ~Camera() = default;

  virtual const FrameFormat& format() const = 0;

  /// Returns what is attached, for people: vendor, model, serial number, address.
  virtual std::string description() const = 0;

  /// Returns sentences on what the camera does otherwise than it was told, and on what it sends.
  virtual std::vector<std::string> notes() const = 0;

  /// These return what the source tells of optics and detector, as recordings and the simulator do.
  virtual Optics optics() const { return {}; }
  virtual Detector detector() const { return {}; }

  /// Sends frames to the exchange, from a thread of its own, until stop(). Each header is complete,
  /// its sequence counts on through wraps of the device's numbers, and the first header is
  /// `renumbered`. A camera that dies or comes to its end closes the exchange. Throws Failure,
  /// which names the device, if it cannot start.
  virtual void start(FrameExchange& exchange) = 0;

  /// Stops sending. When it returns, nothing of the camera touches the exchange any more, and
  /// counts() is final. It works on a dead camera too, within a second or so.
  virtual void stop() noexcept = 0;

  /// Starts a frame if the trigger is software. Throws Failure if it is not.
  virtual void trigger() {
    throw Failure(description().append(" takes no software trigger, set trigger = \"software\""));
  }

  /// Returns the exposure time in µs, or 0 where the camera does not tell it.
  virtual double exposure_us() { return 0.0; }
  /// Sets the exposure time while frames come, held within what the camera can do, and returns the
  /// one that it has now. Throws Failure, which names the device, where it cannot be set. One
  /// thread at a time calls these two.
  virtual double set_exposure_us(double exposure_us) {
    static_cast<void>(exposure_us);
    throw Failure(description().append(" has no exposure time that can be set"));
  }

  /// Returns why the camera closed the exchange; empty while it is well, and if it came to its
  /// natural end.
  virtual std::string failure() const = 0;

  virtual FrameCounts counts() const = 0;
};

/// Lets the camera stream into the exchange as long as this object lives.
class Streaming {
 public:
  Streaming(Camera& camera, FrameExchange& exchange) : camera_(camera) { camera.start(exchange); }
  ~Streaming() { camera_.stop(); }
  Streaming(const Streaming&) = delete;
  Streaming& operator=(const Streaming&) = delete;

 private:
  Camera& camera_;
};

/// A camera calls this once in every thread in which it takes frames, before the first frame, so
/// that the thread can be pinned and get its priority.
using ThreadStart = std::function<void()>;

}  // namespace curlew
