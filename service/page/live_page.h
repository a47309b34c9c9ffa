// LivePage shows frames as they come, at most thirty a second.
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "service/page/frame_tap.h"
#include "service/page/page_source.h"

namespace curlew {

/// Frames pass in one thread, and viewers ask in another. All viewers see the same frames. While
/// nobody asks, no frame is copied.
class LivePage final : public PageSource {
 public:
  /// status: returns the daemon's status, a JSON object. title: says where the frames come from.
  /// settings: those that the page may change; none where it may do nothing but look.
  LivePage(std::function<std::string()> status, std::string title,
           std::vector<std::string> settings)
      : status_of_(std::move(status)), title_(std::move(title)), settings_(std::move(settings)) {}

  /// The publisher's thread calls this once a frame: see FrameTap.
  void pass(const FrameSlot& slot, std::int64_t dropped) noexcept { tap_.pass(slot, dropped); }

  /// Frames of this plan may come from now on. Any thread may call it.
  void know(std::shared_ptr<const Plan> plan);

  std::string status() override;
  PageMessage sensor(std::int64_t plan) override;
  PageMessage frame(std::int64_t number, std::chrono::milliseconds waited) override;
  std::chrono::milliseconds between_frames() const override { return kBetweenFrames; }

 private:
  static constexpr std::chrono::milliseconds kBetweenFrames{33};

  void look();
  std::shared_ptr<PagePlan> plan_of(const Plan* plan);

  std::function<std::string()> status_of_;
  std::string title_;
  std::vector<std::string> settings_;
  FrameTap tap_;

  // Only the viewers' thread touches these.
  PageMessage newest_;
  std::int64_t newest_number_ = 0;  ///< counts the frames that were shown, from 1
  bool asked_ = false;
  std::chrono::steady_clock::time_point shown_{};

  std::mutex mutex_;                              // It guards everything below.
  std::vector<std::shared_ptr<PagePlan>> plans_;  ///< the last ones, the newest at the end
  std::int64_t plans_known_ = 0;
};

}  // namespace curlew
