// FrameNumbering: a device's frame numbers, unwrapped, and what is missing among them.
#pragma once

#include <cstdint>

namespace curlew {

/// Turns the numbers of arriving frames into a sequence that only grows and counts what never came.
/// Every number between the first and the last is then either a frame that arrived or lost:
/// last − first + 1 = frames that arrived, numbered or not, + lost.
/// Pure; one thread.
class FrameNumbering {
 public:
  /// wraps_at_16_bits: 65535 is followed by 1, as GigE Vision counts; one that shows a larger
  /// number counts in 64 bits all the same.
  explicit FrameNumbering(bool wraps_at_16_bits) : narrow_(wraps_at_16_bits) {}

  struct Arrival {
    std::int64_t sequence = 0;
    std::int64_t lost = 0;    ///< numbers just before it that never came
    bool renumbered = false;  ///< the device began to count anew: nothing is known of before
  };

  /// The device may count anew from here on.
  void restart() noexcept { continues_ = false; }

  /// A frame with the device's number `id` arrived.
  Arrival numbered(std::uint64_t id) noexcept {
    if (id > kLast16) narrow_ = false;
    Arrival arrival;
    const std::int64_t step = continues_ ? step_to(id) : 0;
    if (step > unnumbered_) {
      arrival.lost = step - 1 - unnumbered_;
      arrival.sequence = last_ + step;
    } else {
      // Numbers went back, or fewer are free than frames came without one.
      arrival.renumbered = true;
      arrival.sequence = started_ ? last_ + unnumbered_ + 1 : static_cast<std::int64_t>(id);
    }
    if (!started_) first_ = arrival.sequence - unnumbered_;
    started_ = true;
    continues_ = true;
    unnumbered_ = 0;
    last_id_ = id;
    last_ = arrival.sequence;
    return arrival;
  }

  /// A frame arrived whose number got lost with a part of it. It takes one of the numbers that
  /// would otherwise count as lost.
  void unnumbered() noexcept { ++unnumbered_; }

  /// Sequence of the first and the last frame that arrived; last() < first(): none did.
  std::int64_t first() const noexcept { return started_ ? first_ : 0; }
  std::int64_t last() const noexcept { return (started_ ? last_ : -1) + unnumbered_; }

 private:
  static constexpr std::uint64_t kLast16 = 65535;

  /// How many numbers further `id` is than the last one; not positive where it went back.
  std::int64_t step_to(std::uint64_t id) const noexcept {
    if (!narrow_) return static_cast<std::int64_t>(id - last_id_);
    constexpr auto ring = static_cast<std::int64_t>(kLast16);
    const std::int64_t step = static_cast<std::int64_t>(id) - static_cast<std::int64_t>(last_id_);
    const std::int64_t forward = (step + ring) % ring;
    return forward > ring / 2 ? forward - ring : forward;
  }

  bool narrow_;
  bool started_ = false;    // some frame had a number
  bool continues_ = false;  // the next number follows last_id_
  std::uint64_t last_id_ = 0;
  std::int64_t first_ = 0;
  std::int64_t last_ = 0;
  std::int64_t unnumbered_ = 0;  // since the last one with a number
};

}  // namespace curlew
