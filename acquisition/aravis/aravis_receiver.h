// An AravisReceiver does what happens in Aravis' stream thread, once per frame.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "acquisition/aravis/aravis_handle.h"
#include "acquisition/aravis/aravis_pixels.h"
#include "acquisition/camera.h"
#include "acquisition/frame_numbering.h"

namespace curlew {

/// Takes the buffers of a stream as they are done, in the stream's own thread, and delivers whole
/// frames. If the bytes that a camera sends are the pixels as we want them, the stream writes into
/// the exchange's buffers. Otherwise it writes into buffers of its own, from which pixels are
/// copied or unpacked.
///
/// The order is: begin() → the stream is made with on_stream_event → feed() → frames → the stream's
/// thread ends → end(). Then it may begin again.
class AravisReceiver {
 public:
  /// payload_bytes: how many bytes the camera sends for a frame. staging: how many buffers of its
  /// own the stream gets, if it needs them.
  AravisReceiver(const PixelCoding& coding, const FrameFormat& format, std::size_t payload_bytes,
                 std::size_t staging, bool ids_wrap_at_16_bits, ThreadStart thread_start);

  /// Prepares for a stream into this exchange.
  void begin(FrameExchange& exchange);
  /// Gives the stream its buffers.
  void feed(ArvStream* stream);
  /// Blocks until the stream's thread has made its last call.
  void wait_for_thread() const noexcept;
  /// Puts the buffers that the stream still has back into the exchange.
  void end() noexcept;

  FrameCounts counts() const noexcept;
  /// Returns one sentence on which of 16 bits the first frames used; empty before they came, and if
  /// all bits are used.
  std::string justification() const;

  /// This is an ArvStreamCallback, whose receiver is an AravisReceiver.
  static void on_stream_event(void* receiver, ArvStreamCallbackType event, ArvBuffer*);

 private:
  /// Holds a buffer of the stream.
  struct Slot {
    GObjectPtr<ArvBuffer> buffer;
    FrameBuffer* frame = nullptr;  ///< frame that it fills; nullptr if it has its own memory
    bool in_stream = false;        ///< whether the stream has it
  };

  /// Makes a slot with memory of its own, whose pixels are copied.
  std::unique_ptr<Slot> own_memory() const;
  /// Takes over a buffer popped from the stream.
  void take_done(ArvStream* stream, ArvBuffer* buffer) noexcept;
  bool has_agreed_shape(ArvBuffer* buffer) const noexcept;
  /// Numbers the frame and counts what is missing before it.
  void number(ArvStream* stream, std::uint64_t id, FrameHeader& header) noexcept;
  /// Returns the frame with the pixels of the slot; nullptr if no buffer is free for them.
  FrameBuffer* filled_frame(Slot& slot) noexcept;
  void copy_pixels(ArvBuffer* buffer, FrameBuffer& frame) const noexcept;
  void watch_bits(const FrameBuffer& frame) noexcept;
  void push(ArvStream* stream, Slot& slot) noexcept;
  /// Gives the slot, whose pixels nobody holds, to the stream again, unless it is the reserve.
  void recycle(ArvStream* stream, Slot& slot) noexcept;
  /// Gives the stream what the pipeline gave back. If the stream has its own buffers, takes a spare
  /// frame to copy into instead.
  void push_returned(ArvStream* stream) noexcept;
  void push_frame(ArvStream* stream, FrameBuffer* frame) noexcept;

  const PixelCoding& coding_;
  const FrameFormat format_;
  const std::size_t payload_bytes_;
  const std::size_t staging_;  // 0 if the stream writes into the exchange's buffers
  const ThreadStart thread_start_;

  std::atomic<ArvStream*> stream_{nullptr};
  std::atomic<bool> thread_runs_{false};
  FrameExchange* exchange_ = nullptr;
  std::vector<std::unique_ptr<Slot>> slots_;
  // A stream without any buffer never calls back again, not even when the pipeline has given some
  // back. It gets this slot when it has no other.
  std::unique_ptr<Slot> reserve_;
  int in_stream_ = 0;             // number of slots that the stream has
  FrameBuffer* spare_ = nullptr;  // the frame to copy into next
  FrameNumbering numbering_;
  bool renumbered_ = false;      // numbers began anew since the last delivered frame
  bool gap_ = false;             // a frame is missing since the last delivered one
  std::uint64_t underruns_ = 0;  // Aravis' count of packets without a buffer, when last asked

  enum Cause : std::size_t {
    kDelivered,
    kIncomplete,
    kTimedOut,
    kAborted,
    kWrongSize,
    kOther,
    kLost,
    kNoBuffer,
    kCauses
  };
  static Cause cause_of(ArvBufferStatus status) noexcept;
  void count(Cause cause, std::int64_t frames = 1) noexcept;
  std::array<std::atomic<std::int64_t>, kCauses> counts_{};

  std::atomic<unsigned> used_bits_{0};
  std::atomic<int> frames_watched_{0};
};

}  // namespace curlew
