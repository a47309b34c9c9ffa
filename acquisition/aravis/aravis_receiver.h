// AravisReceiver: what happens in Aravis' stream thread, once a frame.
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
/// frames. Where the bytes a camera sends are the pixels as we want them, the stream writes into
/// the exchange's buffers; else into buffers of its own, from which pixels are copied or unpacked.
///
/// begin() → the stream is made with on_stream_event → feed() → frames → the stream's thread ends →
/// end(); and again.
class AravisReceiver {
 public:
  /// payload_bytes: what the camera sends for a frame. staging: buffers of its own, where needed.
  AravisReceiver(const PixelCoding& coding, const FrameFormat& format, std::size_t payload_bytes,
                 std::size_t staging, bool ids_wrap_at_16_bits, ThreadStart thread_start);

  void begin(FrameExchange& exchange);
  /// Gives the stream its buffers.
  void feed(ArvStream* stream);
  /// Blocks until the stream's thread has made its last call.
  void wait_for_thread() const noexcept;
  /// Puts the buffers that the stream still has back into the exchange.
  void end() noexcept;

  FrameCounts counts() const noexcept;
  /// One sentence on which of 16 bits the first frames used; empty before, and where all are used.
  std::string justification() const;

  /// An ArvStreamCallback; receiver: an AravisReceiver.
  static void on_stream_event(void* receiver, ArvStreamCallbackType event, ArvBuffer*);

 private:
  /// A buffer of the stream.
  struct Slot {
    GObjectPtr<ArvBuffer> buffer;
    FrameBuffer* frame = nullptr;  ///< whose pixels it fills; nullptr: its own memory
    bool in_stream = false;
  };

  /// A slot whose pixels are copied.
  std::unique_ptr<Slot> own_memory() const;
  /// Takes over a buffer popped from the stream.
  void take_done(ArvStream* stream, ArvBuffer* buffer) noexcept;
  bool has_agreed_shape(ArvBuffer* buffer) const noexcept;
  /// Numbers the frame and counts what is missing before it.
  void number(ArvStream* stream, std::uint64_t id, FrameHeader& header) noexcept;
  /// Returns the frame with the pixels of the slot; nullptr where no buffer is free for them.
  FrameBuffer* filled_frame(Slot& slot) noexcept;
  void copy_pixels(ArvBuffer* buffer, FrameBuffer& frame) const noexcept;
  void watch_bits(const FrameBuffer& frame) noexcept;
  void push(ArvStream* stream, Slot& slot) noexcept;
  /// Gives the stream a slot again whose pixels nobody holds.
  void recycle(ArvStream* stream, Slot& slot) noexcept;
  /// Gives the stream what the pipeline gave back.
  void push_returned(ArvStream* stream) noexcept;
  void push_frame(ArvStream* stream, FrameBuffer* frame) noexcept;

  const PixelCoding& coding_;
  const FrameFormat format_;
  const std::size_t payload_bytes_;
  const std::size_t staging_;  // 0: the stream writes into the exchange's buffers
  const ThreadStart thread_start_;

  std::atomic<ArvStream*> stream_{nullptr};
  std::atomic<bool> thread_runs_{false};
  FrameExchange* exchange_ = nullptr;
  std::vector<std::unique_ptr<Slot>> slots_;
  // A stream without any buffer calls back no more, not even when the pipeline has given some back:
  // then it gets this one.
  std::unique_ptr<Slot> reserve_;
  int in_stream_ = 0;             // slots the stream has
  FrameBuffer* spare_ = nullptr;  // the next to copy into
  FrameNumbering numbering_;
  bool renumbered_ = false;  // since the last delivered frame
  bool gap_ = false;         // a frame is missing since the last delivered one
  std::uint64_t underruns_ = 0;

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
