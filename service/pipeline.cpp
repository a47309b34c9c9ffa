#include "service/pipeline.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <exception>
#include <thread>
#include <utility>

#include "core/slot_queue.h"
#include "core/stage_timer.h"
#include "core/team.h"
#include "service/realtime/realtime.h"

namespace curlew {
namespace {

using Clock = std::chrono::steady_clock;
using Queue = SlotQueue<FrameSlot>;

/// Returns how many workers take frames: in a team one for each CPU that is named, or for each that
/// the process may use, of which a few are enough; but no more than there may be frames under way.
std::size_t count_workers(const PipelineOptions& options) {
  if (options.threads == Threading::kInline) return 1;
  constexpr std::size_t kEnough = 4;
  const std::size_t wanted = options.cpus.empty()
                                 ? std::min(static_cast<std::size_t>(usable_cpus()), kEnough)
                                 : options.cpus.size();
  return std::clamp<std::size_t>(wanted, 1, options.slots);
}

void run_stage(std::size_t stage, FrameSlot& slot) noexcept {
  const auto start = Clock::now();
  kStages[stage].run(*slot.plan, slot);
  if (slot.broke_off) return;
  // What the first stage waits for the last rows of a frame is the camera's time.
  slot.latency.stage_ns[stage] = nanoseconds_since(std::max(start, slot.frame->header.received));
}

}  // namespace

Pipeline::Pipeline(std::shared_ptr<const Plan> plan, PipelineOptions options,
                   PipelineThreadStart thread_start, std::int64_t sets_before)
    : options_(std::move(options)),
      workers_(count_workers(options_)),
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
  // More than are worked on at once would only push each other out of the caches.
  for (std::size_t i = 0; i < workers_; ++i)
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
    run_team(feed, publisher);
  report_.seconds = std::chrono::duration<double>(Clock::now() - start).count();
  return report_;
}

/// Says how long the frame took until it can be published.
void Pipeline::complete(FrameSlot& slot) const noexcept {
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
    if (!slot->broke_off) {
      complete(*slot);
      publish(*slot, publisher);
    }
    feed.release(*slot);
  }
}

/// What the workers of a run share. One of them leads: it takes the next frame and measures its
/// spots, and those that have nothing to do help. Then another one leads, while the first goes on
/// with its frame. Tracks and results keep the order of the frames: each frame has its turn.
struct Pipeline::TeamRun {
  TeamRun(Feed& frames, const Publisher& out, std::size_t slots)
      : feed(frames), publisher(out), free(slots) {}

  Feed& feed;
  const Publisher& publisher;
  Queue free;  ///< slots without a frame; the leader takes them, whose turn it is gives them back
  Team team;
  std::atomic<bool> led{true};     ///< there is a leader, or the workers are not all there yet
  std::atomic<bool> ended{false};  ///< there are no more frames
  std::atomic<bool> failed{false};
  std::atomic<std::int64_t> tracked{0};    ///< the frames that the stage in order is done with
  std::atomic<std::int64_t> published{0};  ///< the frames that are published
  std::int64_t taken = 0;                  ///< frames; only the leader touches it
  // Read after the workers are joined.
  std::exception_ptr feed_failure;     ///< written by the leader
  std::exception_ptr publish_failure;  ///< written by the worker whose turn it is
};

void Pipeline::run_team(Feed& feed, const Publisher& publisher) {
  TeamRun run(feed, publisher, current_->slots.size());
  for (auto& slot : current_->slots) run.free.push(slot.get());
  std::vector<std::thread> threads;
  const auto join = [&] {
    run.team.ring();
    for (std::thread& thread : threads) thread.join();
  };
  try {
    for (std::size_t number = 0; number < workers_; ++number)
      threads.emplace_back([this, &run, number] { work(run, number); });
  } catch (...) {
    run.ended = true;
    join();
    throw;
  }
  run.led = false;
  join();
  if (run.publish_failure) std::rethrow_exception(run.publish_failure);
  if (run.feed_failure) std::rethrow_exception(run.feed_failure);
}

void Pipeline::work(TeamRun& run, std::size_t number) {
  thread_start_("worker", number);
  const Team::Side side = number % 2 == 0 ? Team::Side::kFront : Team::Side::kBack;
  while (true) {
    bool leads = false;
    run.team.wait_until(
        [&] {
          leads = !run.led.load(std::memory_order_relaxed) &&
                  !run.led.exchange(true, std::memory_order_acquire);
          return leads || run.ended.load(std::memory_order_acquire);
        },
        side);
    if (!leads) return;
    run.team.lead_from(side);
    std::int64_t turn = 0;
    FrameSlot* slot = lead(run, turn);
    run.led.store(false, std::memory_order_release);
    run.team.ring();
    if (slot == nullptr) return;
    finish(run, *slot, turn, side);
  }
}

/// Takes the next frame, says the number of its turn and runs the first stage. Returns its slot, or
/// null at the end.
FrameSlot* Pipeline::lead(TeamRun& run, std::int64_t& turn) noexcept {
  constexpr std::int64_t kWorthSharing_px = 1 << 16;
  FrameSlot* slot = nullptr;
  try {
    const bool more = !run.ended.load(std::memory_order_relaxed) &&
                      !run.failed.load(std::memory_order_acquire) && run.free.pop(slot) &&
                      run.feed.fill(*slot);
    if (!more) slot = nullptr;
  } catch (...) {
    run.feed_failure = std::current_exception();
    slot = nullptr;
  }
  if (slot == nullptr) {
    run.ended.store(true, std::memory_order_release);
    return nullptr;
  }
  slot = renewed(slot);
  turn = run.taken++;
  const FrameFormat& format = slot->frame->format();
  slot->team = std::int64_t{format.rows} * format.cols >= kWorthSharing_px ? &run.team : nullptr;
  run_stage(0, *slot);
  slot->team = nullptr;
  return slot;
}

/// Runs the other stages, publishes the frame when its turn has come, and gives its slot back.
void Pipeline::finish(TeamRun& run, FrameSlot& slot, std::int64_t turn, Team::Side side) noexcept {
  const auto wait_for_turn = [&](const std::atomic<std::int64_t>& turns) {
    run.team.wait_until([&] { return turns.load(std::memory_order_acquire) == turn; }, side);
  };
  const auto pass_on = [&](std::atomic<std::int64_t>& turns) {
    turns.store(turn + 1, std::memory_order_release);
    run.team.ring();
  };
  for (std::size_t stage = 1; stage < kStageCount; ++stage) {
    if (kStages[stage].in_order) wait_for_turn(run.tracked);
    if (!slot.broke_off) run_stage(stage, slot);
    if (kStages[stage].in_order) pass_on(run.tracked);
  }
  wait_for_turn(run.published);
  try {
    if (!slot.broke_off && !run.failed.load(std::memory_order_relaxed)) {
      complete(slot);
      publish(slot, run.publisher);
    }
  } catch (...) {
    run.publish_failure = std::current_exception();
    run.failed.store(true, std::memory_order_release);
  }
  run.feed.release(slot);
  run.free.push(&slot);
  pass_on(run.published);
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
