#include "service/pipeline.h"

#include <pthread.h>
#include <sched.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <exception>
#include <thread>

#include "core/slot_queue.h"
#include "core/stage_timer.h"
#include "service/interrupt.h"

namespace curlew {
namespace {

using Clock = std::chrono::steady_clock;
using Queue = SlotQueue<FrameSlot>;

void run_stage(std::size_t stage, const Plan& plan, FrameSlot& slot) noexcept {
  const StageTimer timer(slot.latency.stage_ns[stage]);
  kStages[stage].run(plan, slot);
}

void end_of_stages(FrameSlot& slot) noexcept {
  slot.latency.total_ns = nanoseconds_since(slot.frame.header.received);
}

/// Pins the calling thread to the n-th of `cpus` in turn; false where the system refuses.
bool pin_thread(const std::vector<int>& cpus, std::size_t n) noexcept {
  if (cpus.empty()) return true;
  cpu_set_t set;
  CPU_ZERO(&set);
  CPU_SET(static_cast<std::size_t>(cpus[n % cpus.size()]), &set);
  return pthread_setaffinity_np(pthread_self(), sizeof set, &set) == 0;
}

std::string describe_pinning(const std::vector<int>& cpus, bool pinned) {
  if (cpus.empty()) return "none";
  std::string text = pinned ? "cpu" : "refused by the system: cpu";
  for (const int cpu : cpus) text.append(" ").append(std::to_string(cpu));
  return text;
}

}  // namespace

/// The source, paced and counted.
class Pipeline::Feed {
 public:
  Feed(FrameSource& source, const RunOptions& options)
      : source_(source), options_(options), next_(Clock::now()) {}

  bool fill(FrameSlot& slot) {
    if (delivered_ == options_.max_frames || interrupted()) return false;
    if (source_.next(slot.frame) == Delivery::kEnd) return false;
    if (options_.pace_hz > 0.0) {
      std::this_thread::sleep_until(next_);
      slot.frame.header.received = Clock::now();
      // From now and not from when it was due: after a stall no frames come in a burst.
      next_ =
          slot.frame.header.received + std::chrono::duration_cast<Clock::duration>(
                                           std::chrono::duration<double>(1.0 / options_.pace_hz));
    }
    slot.frame_index = delivered_++;
    slot.latency = {};
    return true;
  }

 private:
  FrameSource& source_;
  RunOptions options_;
  Clock::time_point next_;
  std::int64_t delivered_ = 0;
};

Pipeline::Pipeline(const Plan& plan, const FrameFormat& format, const PipelineOptions& options)
    : plan_(plan), options_(options) {
  const std::size_t slots = options.threads == Threading::kInline ? 1 : options.slots;
  for (std::size_t i = 0; i < slots; ++i)
    slots_.push_back(std::make_unique<FrameSlot>(plan, format));
}

RunReport Pipeline::run(FrameSource& source, const Publisher& publisher,
                        const RunOptions& options) {
  report_ = {};
  last_sequence_.reset();
  Feed feed(source, options);
  const auto start = Clock::now();
  if (options_.threads == Threading::kInline)
    run_inline(feed, publisher);
  else
    run_per_stage(feed, publisher);
  report_.seconds = std::chrono::duration<double>(Clock::now() - start).count();
  return report_;
}

void Pipeline::run_inline(Feed& feed, const Publisher& publisher) {
  report_.pinning = describe_pinning(options_.cpus, pin_thread(options_.cpus, 0));
  FrameSlot& slot = *slots_.front();
  while (feed.fill(slot)) {
    for (std::size_t stage = 0; stage < kStageCount; ++stage) run_stage(stage, plan_, slot);
    end_of_stages(slot);
    publish(slot, publisher);
  }
}

/// This thread feeds; one thread a stage works; the last publishes and gives the slot back.
void Pipeline::run_per_stage(Feed& feed, const Publisher& publisher) {
  Queue free(slots_.size());
  std::vector<std::unique_ptr<Queue>> to_stage;  // the last one leads to the publisher
  for (std::size_t i = 0; i <= kStageCount; ++i)
    to_stage.push_back(std::make_unique<Queue>(slots_.size()));
  for (auto& slot : slots_) free.push(slot.get());

  std::atomic<bool> pinned{true};
  std::atomic<bool> failed{false};
  std::exception_ptr failure;  // of the publisher; read after its thread is joined
  const auto work = [&](std::size_t stage) {
    if (!pin_thread(options_.cpus, stage)) pinned = false;
    FrameSlot* slot = nullptr;
    while (to_stage[stage]->pop(slot)) {
      run_stage(stage, plan_, *slot);
      if (stage + 1 == kStageCount) end_of_stages(*slot);
      to_stage[stage + 1]->push(slot);
    }
    to_stage[stage + 1]->close();
  };
  const auto hand_out = [&] {
    if (!pin_thread(options_.cpus, kStageCount)) pinned = false;
    FrameSlot* slot = nullptr;
    while (to_stage[kStageCount]->pop(slot)) {
      try {
        if (!failed) publish(*slot, publisher);
      } catch (...) {
        failure = std::current_exception();
        failed = true;
      }
      free.push(slot);
    }
  };

  std::exception_ptr feed_failure;  // of the source, or of starting a thread
  std::vector<std::thread> threads;
  try {
    for (std::size_t stage = 0; stage < kStageCount; ++stage) threads.emplace_back(work, stage);
    threads.emplace_back(hand_out);
    FrameSlot* slot = nullptr;
    while (!failed && free.pop(slot) && feed.fill(*slot)) to_stage[0]->push(slot);
  } catch (...) {
    feed_failure = std::current_exception();
  }
  to_stage[0]->close();  // and each stage closes the next
  for (std::thread& thread : threads) thread.join();
  report_.pinning = describe_pinning(options_.cpus, pinned);
  if (failure) std::rethrow_exception(failure);
  if (feed_failure) std::rethrow_exception(feed_failure);
}

void Pipeline::publish(FrameSlot& slot, const Publisher& publisher) {
  {
    const StageTimer timer(slot.latency.publish_ns);
    if (publisher.publish) publisher.publish(slot);
  }
  ++report_.frames;
  report_.vortices += static_cast<std::int64_t>(slot.vortices.size());
  report_.overflow += slot.vortices.overflow();
  report_.not_converged += slot.split.converged ? 0 : 1;
  const FrameHeader& header = slot.frame.header;
  if (last_sequence_ && !header.renumbered && header.sequence > *last_sequence_) {
    // Unsigned, because a file may hold any numbers; and no camera loses 2^40 frames.
    const std::uint64_t gap = static_cast<std::uint64_t>(header.sequence) -
                              static_cast<std::uint64_t>(*last_sequence_) - 1;
    report_.dropped += static_cast<std::int64_t>(std::min(gap, std::uint64_t{1} << 40));
  }
  last_sequence_ = header.sequence;
  for (std::size_t stage = 0; stage < kStageCount; ++stage)
    report_.stage[stage].record(slot.latency.stage_ns[stage]);
  report_.publish.record(slot.latency.publish_ns);
  report_.total.record(slot.latency.total_ns);
  if (publisher.finish) publisher.finish(slot, report_.dropped);
}

}  // namespace curlew
