// FrameStore keeps the frames of a replay for the page and for the report.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "service/page/frame_copy.h"
#include "service/page/page_source.h"

namespace curlew {

/// Where there are more frames than it may keep, it keeps every second, every fourth … from the
/// first on. One thread adds, another may show.
class FrameStore final : public PageSource {
 public:
  /// Keeps at most so many frames and bytes of messages.
  FrameStore(std::shared_ptr<const Plan> plan, const std::string& title, std::size_t most_frames,
             std::size_t most_bytes);

  /// Adds a frame, once its latency is complete.
  void add(const FrameSlot& slot, std::int64_t dropped);
  /// No more frames will come.
  void finish();

  std::string status() override;
  PageMessage sensor(std::int64_t plan) override;
  PageMessage frame(std::int64_t number, std::chrono::milliseconds waited) override;

  /// For the report, after finish(): all frames that were kept.
  const std::vector<PageMessage>& frames() const { return frames_; }

 private:
  void thin_out();

  std::size_t most_frames_;
  std::size_t most_bytes_;
  PagePlan plan_;
  PageMessage description_;
  FrameCopy copy_;

  std::mutex mutex_;  // It guards everything below.
  std::vector<PageMessage> frames_;
  std::vector<std::string> points_;      ///< of these frames: PagePlan::point()
  std::vector<FrameLatency> latencies_;  ///< of all frames
  std::size_t bytes_ = 0;
  std::int64_t every_ = 1;  ///< of so many frames one is kept
  bool finished_ = false;
};

}  // namespace curlew
