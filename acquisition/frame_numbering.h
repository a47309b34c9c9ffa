// A FrameNumbering unwraps a device's frame numbers and counts what is missing among them.
#pragma once

#include <cstdint>

namespace curlew {

/// Turns the numbers of arriving frames into a sequence that only grows, and counts the numbers
/// that never came. Every number between the first and the last then belongs to a frame that
/// arrived, or it is lost: last − first + 1 = frames that arrived, numbered or not, + lost. It is
/// for one thread.
class FrameNumbering {
 public:
  /// wraps_at_16_bits: 65535 is followed by 1, as GigE Vision counts. A device that shows a larger
  /// number counts in 64 bits all the same.
  explicit FrameNumbering(bool wraps_at_16_bits) : narrow_(wraps_at_16_bits) {}

  struct Arrival {
    std::int64_t sequence = 0;
    std::int64_t lost = 0;    ///< numbers just before it that never came
    bool renumbered = false;  ///< the device began to count anew, so losses before it are unknown
  };

  /// Lets the device count anew from here on.
  void restart() noexcept { continues_ = false; }

  /// Takes in a frame that arrived with the device's number `id`.
  Arrival numbered(std::uint64_t id) noexcept {
    if (id > kLast16) narrow_ = false;
    Arrival arrival;
    const std::int64_t step = continues_ ? step_to(id) : 0;
    if (step > unnumbered_ && step <= kLastSequence - last_) {
      arrival.lost = step - 1 - unnumbered_;
      arrival.sequence = last_ + step;
    } else {
      // The numbers went back, or fewer of them are free than frames came without one, or they
      // leapt further than any camera counts.
      arrival.renumbered = true;
      arrival.sequence = started_              ? last_ + unnumbered_ + 1
                         : id <= kLastSequence ? static_cast<std::int64_t>(id)
                                               : 0;
    }
    if (!started_) first_ = arrival.sequence - unnumbered_;
    started_ = true;
    continues_ = true;
    unnumbered_ = 0;
    last_id_ = id;
    last_ = arrival.sequence;
    return arrival;
  }

  /// Takes in a frame whose number got lost with a part of it. It takes one of the numbers that
  /// would otherwise count as lost.
  void unnumbered() noexcept { ++unnumbered_; }

  /// These return the sequence of the first and of the last frame that arrived. last() < first()
  /// means that none did.
  std::int64_t first() const noexcept { return started_ ? first_ : 0; }
  std::int64_t last() const noexcept { return (started_ ? last_ : -1) + unnumbered_; }

 private:
  static constexpr std::uint64_t kLast16 = 65535;
  // A sequence goes no further, so that sums of a few do not overflow.
  static constexpr std::int64_t kLastSequence = std::int64_t{1} << 62;

  /// Returns how many numbers `id` is after the last one; not positive if the numbers went back.
  std::int64_t step_to(std::uint64_t id) const noexcept {
    if (!narrow_) return static_cast<std::int64_t>(id - last_id_);
    constexpr auto ring = static_cast<std::int64_t>(kLast16);
    const std::int64_t step = static_cast<std::int64_t>(id) - static_cast<std::int64_t>(last_id_);
    const std::int64_t forward = (step + ring) % ring;
    return forward > ring / 2 ? forward - ring : forward;
  }

  bool narrow_;
  bool started_ = false;    // a frame with a number has arrived
  bool continues_ = false;  // the next number should follow last_id_
  std::uint64_t last_id_ = 0;
  std::int64_t first_ = 0;
  std::int64_t last_ = 0;
  std::int64_t unnumbered_ = 0;  // frames without a number since the last one that had it
};

}  // namespace curlew
