// A LoopSource delivers frames in memory, over and over.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "acquisition/frame_source.h"

namespace curlew {

class LoopSource final : public FrameSource {
 public:
  using Frames = std::vector<std::shared_ptr<const FrameBuffer>>;

  /// frames: at least one, all of one format. count: how many it delivers, −1 if it never ends.
  explicit LoopSource(Frames frames, std::int64_t count = -1)
      : frames_(std::move(frames)), count_(count) {}

  const FrameFormat& format() const override { return frames_.front()->format(); }
  std::int64_t frame_count() const override { return count_; }

  /// The headers are those of the frames in memory, but for sequence and received. If the frames
  /// have a camera's clock, it goes on from lap to lap by the frames' own interval.
  Delivery next(FrameBuffer& into) override {
    if (delivered_ == count_) return Delivery::kEnd;
    const FrameBuffer& frame = *frames_[static_cast<std::size_t>(delivered_) % frames_.size()];
    std::copy_n(frame.view().pixels, format().bytes(), into.data());
    into.header = frame.header;
    const auto lap = delivered_ / static_cast<std::int64_t>(frames_.size());
    into.header.camera_ns += lap * lap_ns();
    into.header.sequence = delivered_++;
    into.header.received = std::chrono::steady_clock::now();
    into.rows_ready = format().rows;
    return Delivery::kFrame;
  }

 private:
  /// Returns by how much the camera's clock goes on in one lap, in ns; 0 if the frames have none.
  std::int64_t lap_ns() const {
    const auto n = static_cast<std::int64_t>(frames_.size());
    const std::int64_t span = frames_.back()->header.camera_ns - frames_.front()->header.camera_ns;
    return n > 1 ? span / (n - 1) * n : 0;
  }

  Frames frames_;
  std::int64_t count_;
  std::int64_t delivered_ = 0;
};

}  // namespace curlew
