// A UsbFrameAssembler turns the bytes of a plain USB camera into frames. It knows nothing of
// libusb.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "acquisition/camera.h"
#include "acquisition/camera_options.h"

namespace curlew {

/// Returns the format of every frame of this layout. Throws UsageError, which names the key in
/// [usb], if the layout makes no sense: rows or cols missing, 9 bits, a sync that is not
/// hexadecimal or longer than the header, a frame number outside the header.
FrameFormat usb_frame_format(const UsbLayout& layout);

/// Returns how many bytes header, pixels and trailer of one frame are.
std::size_t usb_frame_bytes(const UsbLayout& layout);

/// Cuts a stream of bytes into frames. A frame is `header_bytes`, then rows × cols pixels in row
/// order (one byte each, or two, little endian, for more than 8 bits), then `trailer_bytes`. There
/// are two ways to tell where one ends:
///
/// - Without sync, the camera's short packets tell it. One ends every frame (an empty one if the
///   frame's bytes are a multiple of the packet size), and no other packet is short.
/// - With sync, every header begins with these bytes. A frame is whole if its last byte is followed
///   by a short packet or by the next frame's sync. Short packets elsewhere do no harm. After
///   damage the next sync is searched for; if the camera sends no short packets, the damaged
///   frame's neighbours may be lost with it. Choose a sync that pixels cannot contain.
///
/// A frame that is not of the right length is never delivered. Frames are numbered by the 32-bit
/// number in the header, through its wraps, or else counted. A number that goes back or leaps by
/// more than 65536 is taken for damage, unless the next frame counts on from it: then the camera
/// has started anew. Nothing is counted before the first whole frame.
///
/// feed() and end() are for one thread and allocate nothing. counts() is for any thread.
class UsbFrameAssembler {
 public:
  /// Returns a buffer to fill, nullptr if none is free.
  using Empty = std::function<FrameBuffer*()>;
  /// Takes a whole frame and returns a buffer to fill again, or nullptr.
  using Deliver = std::function<FrameBuffer*(FrameBuffer*)>;

  struct Arrival {
    std::chrono::steady_clock::time_point at{};
    std::int64_t utc_ns = 0;
  };

  UsbFrameAssembler(const UsbLayout& layout, Empty empty, Deliver deliver);

  /// Takes bytes in the order in which they came, cut anywhere. ended_short: the last of them ended
  /// a short packet.
  void feed(std::span<const std::byte> bytes, bool ended_short, const Arrival& arrival) noexcept;

  /// Ends the stream; a frame under way is aborted.
  void end() noexcept;

  FrameCounts counts() const noexcept;

 private:
  enum class State {
    kSearching,  ///< it looks for sync
    kBetween,    ///< it is between frames; one may be full and not yet known to be whole
    kInFrame,    ///< it is inside a frame
    kOverlong,   ///< without sync, no short packet came where the frame should have ended
  };
  enum class Outcome { kWhole, kIncomplete, kWrongSize, kAborted };
  enum class Number { kKnown, kMissing, kInDoubt };  ///< what a frame's number is
  using Bytes = std::span<const std::byte>;

  void consume(Bytes bytes) noexcept;
  Bytes match_sync(Bytes bytes) noexcept;
  Bytes fill(Bytes bytes) noexcept;
  void packet_was_short() noexcept;
  bool could_be_restart(Bytes& bytes) noexcept;
  void begin_frame() noexcept;
  void finish(Outcome outcome) noexcept;
  Number account(bool whole) noexcept;
  void deliver() noexcept;

  // The following is the layout.
  std::size_t header_bytes_;
  std::size_t pixel_bytes_;
  std::size_t frame_bytes_;
  int rows_;
  std::ptrdiff_t sequence_offset_;  ///< negative if frames are counted
  std::vector<std::byte> sync_;
  std::vector<std::size_t> shorter_match_;  ///< where to go on in sync_ (Knuth, Morris and Pratt)
  Empty empty_;
  Deliver deliver_;

  // The following is the state of the stream.
  State state_;
  bool full_ = false;         ///< in kBetween: the last frame is full, its end not yet confirmed
  std::size_t matched_ = 0;   ///< bytes of sync_ seen
  std::size_t unframed_ = 0;  ///< bytes since the last frame's end
  /// In kInFrame: a short packet came, and since then nothing but the first withheld_ bytes of
  /// sync_.
  bool after_short_ = false;
  std::size_t withheld_ = 0;  ///< bytes of sync_ that are not yet taken for a part of the frame
  std::size_t position_ = 0;  ///< bytes that have come of the frame under way
  std::vector<std::byte> header_;  ///< the part of its header that is of interest
  FrameBuffer* buffer_ = nullptr;  ///< buffer for its pixels
  Arrival arrival_;                ///< arrival of the bytes being fed
  Arrival full_at_;                ///< arrival of the last byte of the full frame

  // The following is the state of the numbering.
  bool started_ = false;        ///< the first whole frame has come
  bool renumbered_ = false;     ///< the next frame delivered says that numbers began anew
  std::int64_t sequence_ = 0;   ///< sequence of the last frame accounted for
  std::int64_t delivered_ = 0;  ///< sequence of the last one delivered
  std::uint32_t number_ = 0;    ///< the device's number of the last one accounted for
  bool doubtful_ = false;       ///< the last whole frame's number did not follow
  std::uint32_t doubt_ = 0;     ///< that number
  std::int64_t in_doubt_ = 0;   ///< frames in doubt since number_
  mutable FrameCounts counts_;  ///< touched through atomic_ref
};

}  // namespace curlew
