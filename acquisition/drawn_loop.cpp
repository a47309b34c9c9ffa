#include "acquisition/drawn_loop.h"

#include <algorithm>
#include <chrono>
#include <exception>
#include <iterator>
#include <utility>

#include "core/as_size.h"
#include "core/error.h"
#include "core/polite_thread.h"

namespace curlew {

DrawnLoop::DrawnLoop(std::unique_ptr<FrameSource> source, const Plan& plan)
    : source_(std::move(source)), plan_(plan) {
  while (std::ssize(frames_) < plan.frames)
    frames_.push_back(std::make_unique<FrameBuffer>(format()));
  bool more = true;
  while (more && drawn_ < plan.drawn_first) more = draw_one();
  if (drawn_ == 0) throw Failure("there is no frame to send over and over; give at least one");
  if (more && drawn_ < plan.frames)
    drawing_ = std::jthread([this](const std::stop_token& stop) { draw_rest(stop); });
}

Delivery DrawnLoop::next(FrameBuffer& into) {
  if (failed_.load(std::memory_order_acquire)) throw Failure(failure_);
  const FrameBuffer& frame = *frames_[as_size(delivered_ % drawn())];
  std::copy_n(frame.view().pixels, format().bytes(), into.data());
  into.header = frame.header;
  into.header.camera_ns = delivered_ * plan_.interval_ns;
  into.header.sequence = delivered_++;
  into.header.received = std::chrono::steady_clock::now();
  into.rows_ready = format().rows;
  return Delivery::kFrame;
}

/// Returns whether the source had a frame.
bool DrawnLoop::draw_one() {
  const std::int64_t at = drawn_.load(std::memory_order_relaxed);
  if (source_->next(*frames_[as_size(at)]) == Delivery::kEnd) return false;
  drawn_.store(at + 1, std::memory_order_release);
  return true;
}

void DrawnLoop::draw_rest(const std::stop_token& stop) {
  become_polite("curlew-draw");
  try {
    while (!stop.stop_requested() && drawn_ < plan_.frames && draw_one()) continue;
  } catch (const std::exception& error) {
    failure_ = error.what();
    failed_.store(true, std::memory_order_release);
  }
}

}  // namespace curlew
