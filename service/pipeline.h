// Pipeline: takes frames from a feed through the stages to a publisher.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/latency_histogram.h"
#include "service/feed.h"
#include "service/stages.h"

namespace curlew {

/// Latency percentiles of a run, and what was counted on the way.
struct RunReport {
  std::int64_t frames = 0;
  std::int64_t vortices = 0;
  std::int64_t overflow = 0;       ///< vortices beyond the list's capacity
  std::int64_t dropped = 0;        ///< frames missing in the numbering of those that came
  std::int64_t late = 0;           ///< frames whose results missed the deadline
  std::int64_t not_converged = 0;  ///< frames whose split stopped at its iteration limit
  std::array<LatencyHistogram, kStageCount> stage;
  LatencyHistogram publish;
  LatencyHistogram total;
  double seconds = 0.0;

  void merge(const RunReport& other);
};

/// What to do with finished frames. Called in the order of the frames, from one thread.
struct Publisher {
  std::function<void(const FrameSlot&)> publish;
  /// After publish, when the latency of the frame is complete; with the frames lost so far.
  std::function<void(const FrameSlot&, std::int64_t dropped)> finish;
};

/// Called first in each thread of the pipeline, with its number from 0: pinning, priority.
using PipelineThreadStart = std::function<void(const std::string& name, std::size_t number)>;

class Pipeline {
 public:
  /// earlier: pipelines before this one whose tracks must keep their numbers to themselves.
  Pipeline(std::shared_ptr<const Plan> plan, PipelineOptions options,
           PipelineThreadStart thread_start = {}, std::int64_t earlier = 0);

  /// Runs until the feed ends. What the feed or the publisher throws ends the run and is thrown
  /// on, once all threads are joined.
  RunReport run(Feed& feed, const Publisher& publisher);

  /// Any one other thread, also while it runs: the frames fed from now on are worked on by this
  /// plan, and none is lost. Makes the buffers; the run swaps pointers. False while an earlier plan
  /// is still being taken up, which needs a frame a slot: try again later.
  bool adopt(std::shared_ptr<const Plan> plan);

 private:
  /// A plan and the slots made for it.
  struct SlotSet {
    std::shared_ptr<const Plan> plan;
    std::unique_ptr<VortexTracker> tracker;  ///< none: the plan does not track
    std::vector<std::unique_ptr<FrameSlot>> slots;
    std::size_t in_use = 0;  ///< of the slots, the first ones; the feeding thread's
  };

  std::unique_ptr<SlotSet> make_slots(std::shared_ptr<const Plan> plan);
  void start_sets();
  FrameSlot* renewed(FrameSlot* slot) noexcept;
  void run_inline(Feed& feed, const Publisher& publisher);
  void run_per_stage(Feed& feed, const Publisher& publisher);
  void run_stage(std::size_t stage, FrameSlot& slot) const noexcept;
  bool is_late(const FrameSlot& slot) const noexcept;
  void publish(FrameSlot& slot, const Publisher& publisher);

  PipelineOptions options_;
  PipelineThreadStart thread_start_;
  std::vector<std::unique_ptr<SlotSet>> sets_;  ///< touched by adopt() only, once made
  std::int64_t sets_made_;                      ///< likewise, those of earlier pipelines too
  SlotSet* current_ = nullptr;                  ///< the run's
  std::atomic<SlotSet*> pending_{nullptr};      ///< what is being taken up
  RunReport report_;
  std::optional<std::int64_t> last_sequence_;
};

}  // namespace curlew
