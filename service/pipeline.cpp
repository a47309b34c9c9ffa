#include "service/pipeline.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <exception>
#include <thread>
#include <utility>

#include "core/slot_queue.h"
#include "core/stage_timer.h"

namespace curlew {
namespace {

using Clock = std::chrono::steady_clock;
using Queue = SlotQueue<FrameSlot>;

}  // namespace

void RunReport::merge(const RunReport& other) {
  frames += other.frames;
  vortices += other.vortices;
  overflow += other.overflow;
  dropped += other.dropped;
  late += other.late;
  not_converged += other.not_converged;
  measured += other.measured;
  lenslets += other.lenslets;
  in_islands += other.in_islands;
  too_blurred += other.too_blurred;
  for (std::size_t i = 0; i < kFollowStates; ++i) followed[i] += other.followed[i];
  lost += other.lost;
  for (std::size_t i = 0; i < kLensletStates; ++i) unmeasured[i] += other.unmeasured[i];
  for (std::size_t i = 0; i < kStageCount; ++i) stage[i].merge(other.stage[i]);
  publish.merge(other.publish);
  total.merge(other.total);
  seconds += other.seconds;
}

std::string nothing_measured(const RunReport& report) {
  if (report.measured > 0 || report.frames == 0) return {};
  struct Reason {
    LensletState state;
    const char* text;
  };
  std::array<Reason, 5> reasons{{{LensletState::kFaint, "too faint"},
                                 {LensletState::kSaturated, "saturated"},
                                 {LensletState::kAtEdge, "at the edge of their windows"},
                                 {LensletState::kBadPixels, "on bad pixels"},
                                 {LensletState::kLost, "without a spot of their own"}}};
  const auto times = [&](const Reason& reason) {
    return report.unmeasured[static_cast<std::size_t>(reason.state)];
  };
  std::int64_t all = 0;
  for (const Reason& reason : reasons) all += times(reason);
  if (all == 0) return "nothing was measured: the sensor file has no lit lenslet";
  std::stable_sort(reasons.begin(), reasons.end(),
                   [&](const Reason& a, const Reason& b) { return times(a) > times(b); });
  std::string text;
  for (const Reason& reason : reasons) {
    const std::int64_t percent = (200 * times(reason) + all) / (2 * all);
    if (percent > 0)
      text += (text.empty() ? "" : ", ") + std::to_string(percent) + " % " + reason.text;
  }
  return "nothing was measured: of " + std::to_string(all) + " spots in " +
         std::to_string(report.frames) + " frames " + text;
}

std::string followed_text(const RunReport& report) {
  const auto frames = [&](FollowState state) {
    return report.followed[static_cast<std::size_t>(state)];
  };
  std::string text;
  const auto add = [&](FollowState state, const std::string& what) {
    if (frames(state) == 0) return;
    text += (text.empty() ? "" : ", ") + what + " in " + std::to_string(frames(state)) + " of " +
            std::to_string(report.frames) + " frames";
  };
  add(FollowState::kMoved, "windows moved after the spots");
  add(FollowState::kAcquired, "spots were found anew");
  add(FollowState::kLost, "spots were not found");
  add(FollowState::kNoLight, "there was no light");
  if (report.lost > 0) {
    const std::int64_t all = report.lost + report.measured;
    text += (text.empty() ? "" : "; ") + std::to_string((200 * report.lost + all) / (2 * all)) +
            " % of the lenslets had no spot of their own, as beyond the beam";
  }
  return text;
}

std::vector<std::string> doubts(const RunReport& report) {
  constexpr double kManyMissing = 0.05;
  std::vector<std::string> texts;
  if (report.measured == 0 || report.lenslets == 0) return texts;
  const double missing = static_cast<double>(report.lenslets - report.measured - report.lost) /
                         static_cast<double>(report.lenslets);
  if (missing > kManyMissing) {
    texts.push_back(std::to_string(std::lround(100.0 * missing)) +
                    " % of the lenslets in the beam had no slope, because they were faint or "
                    "saturated: what is found beside them is less sure");
  }
  if (report.too_blurred > 0) {
    texts.push_back("in " + std::to_string(report.too_blurred) + " of " +
                    std::to_string(report.frames) +
                    " frames the spots were wider than the classifier knows (a blur of over 0.9 "
                    "lambda/w): it looked for no vortex there; the method whitened would have");
  }
  if (report.in_islands > 0) {
    texts.push_back("in " + std::to_string(report.in_islands) + " of " +
                    std::to_string(report.frames) +
                    " frames missing lenslets cut the phase into islands, each with mean 0: "
                    "rms, modes or a mirror's command over all of it are wrong there (N_ISLANDS, "
                    "and ISLAND beside --save phase)");
  }
  return texts;
}

std::string found_text(const RunReport& report) {
  if (!nothing_measured(report).empty()) return "nothing measured";
  return std::to_string(report.vortices) + " vortices";
}

Pipeline::Pipeline(std::shared_ptr<const Plan> plan, PipelineOptions options,
                   PipelineThreadStart thread_start, std::int64_t sets_before)
    : options_(std::move(options)),
      thread_start_(std::move(thread_start)),
      sets_made_(sets_before) {
  if (!thread_start_) thread_start_ = [](const std::string&, std::size_t) {};
  sets_.push_back(make_slots(std::move(plan)));
  current_ = sets_.back().get();
}

std::unique_ptr<Pipeline::SlotSet> Pipeline::make_slots(std::shared_ptr<const Plan> plan) {
  auto set = std::make_unique<SlotSet>();
  make_state(*plan, *set);
  ++sets_made_;
  const std::size_t slots = options_.threads == Threading::kInline ? 1 : options_.slots;
  for (std::size_t i = 0; i < slots; ++i)
    set->slots.push_back(
        std::make_unique<FrameSlot>(*plan, set->follower.get(), set->tracker.get()));
  set->plan = std::move(plan);
  return set;
}

/// Takes over from the set before what the new plan does not concern. The stage that a state
/// belongs to works on all frames of the old set before those of the new one.
void Pipeline::make_state(const Plan& plan, SlotSet& set) const {
  const SlotSet* before = sets_.empty() ? nullptr : sets_.back().get();
  if (before != nullptr && before->plan->sensor_hash != plan.sensor_hash) before = nullptr;
  const auto keeps = [&](const std::string& section) {
    return before != nullptr &&
           !changed_sections(before->plan->config, plan.config).contains(section);
  };
  if (plan.follower) {
    if (keeps("centroid")) set.follower = before->follower;
    if (!set.follower) set.follower = std::make_shared<WindowFollower>(*plan.follower);
  }
  if (!plan.tracker) return;
  if (keeps("track")) set.tracker = before->tracker;
  if (set.tracker) return;
  // Each of 8 million trackers has 2^40 track numbers of its own, so none is given twice.
  constexpr int kTracksOfASet = 40;
  set.tracker = std::make_shared<VortexTracker>(*plan.tracker, plan.grid.rows, plan.grid.cols,
                                                plan.detect.candidate_capacity());
  set.tracker->number_from(sets_made_ << kTracksOfASet);
}

bool Pipeline::adopt(std::shared_ptr<const Plan> plan) {
  if (pending_.load(std::memory_order_acquire) != nullptr) return false;
  // The set before the current one; none of its slots is in use.
  if (sets_.size() > 1) sets_.erase(sets_.begin());
  sets_.push_back(make_slots(std::move(plan)));
  pending_.store(sets_.back().get(), std::memory_order_release);
  return true;
}

std::optional<FollowerMemory> Pipeline::memory() const {
  const SlotSet& newest = *sets_.back();
  if (!newest.follower) return std::nullopt;
  return newest.follower->memory();
}

void Pipeline::recall(const FollowerMemory& memory) {
  const SlotSet& newest = *sets_.back();
  if (newest.follower && newest.plan->level)
    newest.follower->recall(newest.plan->centroid, *newest.plan->level, memory);
}

/// Takes up a pending plan at once, because between runs no slot is in use, and clears all slots.
void Pipeline::start_sets() {
  if (SlotSet* next = pending_.load(std::memory_order_acquire)) {
    current_ = next;
    pending_.store(nullptr, std::memory_order_release);
  }
  for (auto& slot : current_->slots) slot->frame = nullptr;
  current_->in_use = current_->slots.size();
}

/// Returns the slot itself or, if a new plan is pending, a slot of that plan with the same frame.
FrameSlot* Pipeline::renewed(FrameSlot* slot) noexcept {
  SlotSet* next = pending_.load(std::memory_order_acquire);
  if (next == nullptr || slot->plan == next->plan.get()) return slot;
  FrameSlot* fresh = next->slots[next->in_use++].get();
  fresh->frame = std::exchange(slot->frame, nullptr);
  fresh->frame_index = slot->frame_index;
  if (next->in_use == next->slots.size()) {
    current_ = next;
    pending_.store(nullptr, std::memory_order_release);
  }
  return fresh;
}

RunReport Pipeline::run(Feed& feed, const Publisher& publisher) {
  report_ = {};
  last_sequence_.reset();
  start_sets();
  const auto start = Clock::now();
  if (options_.threads == Threading::kInline)
    run_inline(feed, publisher);
  else
    run_per_stage(feed, publisher);
  report_.seconds = std::chrono::duration<double>(Clock::now() - start).count();
  return report_;
}

void Pipeline::run_stage(std::size_t stage, FrameSlot& slot) const noexcept {
  const auto start = Clock::now();
  kStages[stage].run(*slot.plan, slot);
  if (slot.broke_off) return;
  // What the first stage waits for the last rows of a frame is the camera's time.
  slot.latency.stage_ns[stage] = nanoseconds_since(std::max(start, slot.frame->header.received));
  if (stage + 1 < kStageCount) return;
  slot.latency.total_ns = nanoseconds_since(slot.frame->header.received);
  if (is_late(slot)) slot.frame->header.status |= kFrameLate;
}

bool Pipeline::is_late(const FrameSlot& slot) const noexcept {
  return options_.deadline_us > 0.0 &&
         static_cast<double>(slot.latency.total_ns) > options_.deadline_us * 1e3;
}

void Pipeline::run_inline(Feed& feed, const Publisher& publisher) {
  thread_start_("curlew", 0);
  FrameSlot* slot = current_->slots.front().get();
  while (feed.fill(*slot)) {
    slot = renewed(slot);
    run_stage(0, *slot);
    for (std::size_t stage = 1; stage < kStageCount && !slot->broke_off; ++stage)
      run_stage(stage, *slot);
    if (!slot->broke_off) publish(*slot, publisher);
    feed.release(*slot);
  }
}

/// This thread feeds. Each stage has a thread, and one more publishes and gives the slot back.
void Pipeline::run_per_stage(Feed& feed, const Publisher& publisher) {
  const std::size_t slots = current_->slots.size();
  Queue free(slots);
  // Queue i feeds stage i, and the last one the publisher.
  std::vector<std::unique_ptr<Queue>> to_stage;
  for (std::size_t i = 0; i <= kStageCount; ++i) to_stage.push_back(std::make_unique<Queue>(slots));
  for (auto& slot : current_->slots) free.push(slot.get());

  std::atomic<bool> failed{false};
  std::exception_ptr failure;  // thrown by the publisher; read after its thread is joined
  const auto work = [&](std::size_t stage) {
    thread_start_(kStages[stage].name, stage);
    FrameSlot* slot = nullptr;
    while (to_stage[stage]->pop(slot)) {
      if (stage == 0 || !slot->broke_off) run_stage(stage, *slot);
      to_stage[stage + 1]->push(slot);
    }
    to_stage[stage + 1]->close();
  };
  const auto hand_out = [&] {
    thread_start_("publish", kStageCount);
    FrameSlot* slot = nullptr;
    while (to_stage[kStageCount]->pop(slot)) {
      try {
        if (!failed && !slot->broke_off) publish(*slot, publisher);
      } catch (...) {
        failure = std::current_exception();
        failed = true;
      }
      feed.release(*slot);
      free.push(slot);
    }
  };

  std::exception_ptr feed_failure;  // thrown by the source, or by the start of a thread
  std::vector<std::thread> threads;
  try {
    for (std::size_t stage = 0; stage < kStageCount; ++stage) threads.emplace_back(work, stage);
    threads.emplace_back(hand_out);
    FrameSlot* slot = nullptr;
    while (!failed && free.pop(slot) && feed.fill(*slot)) to_stage[0]->push(renewed(slot));
  } catch (...) {
    feed_failure = std::current_exception();
  }
  to_stage[0]->close();  // each stage then closes the queue of the next
  for (std::thread& thread : threads) thread.join();
  if (failure) std::rethrow_exception(failure);
  if (feed_failure) std::rethrow_exception(feed_failure);
}

void Pipeline::count_lenslets(const Centroids& centroids) noexcept {
  report_.measured += centroids.n_valid;
  if (report_.measured > 0) return;  // The rest is needed only if nothing is measured at all.
  for (const LensletState state : centroids.state)
    ++report_.unmeasured[static_cast<std::size_t>(state)];
}

void Pipeline::publish(FrameSlot& slot, const Publisher& publisher) {
  {
    const StageTimer timer(slot.latency.publish_ns);
    if (publisher.publish) publisher.publish(slot);
  }
  const FrameHeader& header = slot.frame->header;
  ++report_.frames;
  count_lenslets(slot.centroids);
  if (slot.follower != nullptr) ++report_.followed[static_cast<std::size_t>(slot.follow_state)];
  report_.lost += slot.centroids.n_lost;
  report_.lenslets += slot.plan->split.lattice().n_lenslets();
  report_.in_islands += slot.split.n_large_islands > 1 ? 1 : 0;
  report_.too_blurred += slot.detect_workspace.spots_are_too_wide() ? 1 : 0;
  report_.vortices += static_cast<std::int64_t>(slot.vortices.size());
  report_.overflow += slot.vortices.overflow();
  report_.not_converged += slot.split.converged ? 0 : 1;
  report_.late += is_late(slot) ? 1 : 0;
  if (last_sequence_ && !header.renumbered && header.sequence > *last_sequence_) {
    // The difference is unsigned because a file may hold any numbers. It is capped because no
    // camera loses 2^40 frames.
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
