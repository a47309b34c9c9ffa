// Pipeline takes frames from a feed through the stages to a publisher.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/centroids.h"
#include "core/team.h"
#include "service/feed.h"
#include "service/results/run_report.h"
#include "service/stages.h"

namespace curlew {

/// What is done with finished frames. The calls come in the order of the frames and never two at
/// once, but not always from the same thread.
struct Publisher {
  std::function<void(const FrameSlot&)> publish;
  /// This is called after publish, when the frame's latency is complete, with the number of frames
  /// lost so far.
  std::function<void(FrameSlot&, std::int64_t dropped)> finish;
};

/// Each thread of the pipeline calls this first, with its number from 0. It sets CPU and priority.
using PipelineThreadStart = std::function<void(const std::string& name, std::size_t number)>;

class Pipeline {
 public:
  /// sets_before: the sets_made() of the pipeline before this one, whose track numbers are not
  /// given again.
  Pipeline(std::shared_ptr<const Plan> plan, PipelineOptions options,
           PipelineThreadStart thread_start = {}, std::int64_t sets_before = 0);

  /// Runs until the feed ends. If the feed or the publisher throws, the run ends, and the exception
  /// is thrown on once all threads are joined.
  RunReport run(Feed& feed, const Publisher& publisher);

  /// Makes the slots for a new plan; frames that are fed from now on are worked on by this plan,
  /// and no frame is lost. Tracks go on where sensor and [track] are the same as before, and
  /// windows stay with their spots where sensor and [centroid] are. Any one other thread may call
  /// it during a run, which only swaps pointers. Returns false while an earlier plan is still being
  /// taken up, which takes one frame for each slot. Then try again later.
  bool adopt(std::shared_ptr<const Plan> plan);

  /// Returns how many sets of slots this pipeline and those before it have made. Call it where
  /// adopt() may be called.
  std::int64_t sets_made() const { return sets_made_; }

  /// What frames have taught the windows of the newest plan; empty if they stay where they are. Not
  /// during a run.
  std::optional<FollowerMemory> memory() const;
  /// Lets the windows go on as after the frames that taught `memory`. Not during a run.
  void recall(const FollowerMemory& memory);

 private:
  /// A plan and the slots made for it. What frames have taught may be shared with the set before.
  struct SlotSet {
    std::shared_ptr<const Plan> plan;
    std::shared_ptr<WindowFollower> follower;  ///< null if the windows stay
    std::shared_ptr<VortexTracker> tracker;    ///< null if the plan does not track
    std::vector<std::unique_ptr<FrameSlot>> slots;
    /// How many slots, from the first, are in use; only the thread that feeds touches it.
    std::size_t in_use = 0;
  };

  struct TeamRun;  // what the workers of a run share

  std::unique_ptr<SlotSet> make_slots(std::shared_ptr<const Plan> plan);
  void make_state(const Plan& plan, SlotSet& set) const;
  void start_sets();
  FrameSlot* renewed(FrameSlot* slot) noexcept;
  void run_inline(Feed& feed, const Publisher& publisher);
  void run_team(Feed& feed, const Publisher& publisher);
  void work(TeamRun& run, std::size_t number);
  FrameSlot* lead(TeamRun& run, std::int64_t& turn) noexcept;
  void finish(TeamRun& run, FrameSlot& slot, std::int64_t turn, Team::Side side) noexcept;
  void complete(FrameSlot& slot) const noexcept;
  bool is_late(const FrameSlot& slot) const noexcept;
  void publish(FrameSlot& slot, const Publisher& publisher);
  void count_lenslets(const Centroids& centroids) noexcept;

  PipelineOptions options_;
  std::size_t workers_;  ///< that take frames, and slots of each set
  PipelineThreadStart thread_start_;
  std::vector<std::unique_ptr<SlotSet>> sets_;  ///< only adopt() touches it after construction
  std::int64_t sets_made_;                      ///< only adopt() touches it after construction
  SlotSet* current_ = nullptr;                  ///< the set of the run
  std::atomic<SlotSet*> pending_{nullptr};      ///< the set that is being taken up
  RunReport report_;
  std::optional<std::int64_t> last_sequence_;
};

}  // namespace curlew
