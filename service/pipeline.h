// Pipeline: takes frames from a source through the stages to a publisher.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "acquisition/frame_source.h"
#include "core/latency_histogram.h"
#include "service/stages.h"

namespace curlew {

/// Latency percentiles of a run, and what was counted on the way.
struct RunReport {
  std::int64_t frames = 0;
  std::int64_t vortices = 0;
  std::int64_t overflow = 0;       ///< vortices beyond the list's capacity
  std::int64_t dropped = 0;        ///< frames the source's numbering says were lost before us
  std::int64_t not_converged = 0;  ///< frames whose split stopped at its iteration limit
  std::array<LatencyHistogram, kStageCount> stage;
  LatencyHistogram publish;
  LatencyHistogram total;
  double seconds = 0.0;
  std::string pinning;  ///< what the threads were really pinned to
};

/// What to do with finished frames. Called in the order of the frames, from one thread.
struct Publisher {
  std::function<void(const FrameSlot&)> publish;
  /// After publish, when the latency of the frame is complete; with the frames lost so far.
  std::function<void(const FrameSlot&, std::int64_t dropped)> finish;
};

struct RunOptions {
  double pace_hz = 0.0;  ///< deliver frames no faster than this; 0: as fast as they can be taken
  std::int64_t max_frames = -1;  ///< stop after so many; −1: at the source's end
};

class Pipeline {
 public:
  Pipeline(const Plan& plan, const FrameFormat& format, const PipelineOptions& options);

  /// Runs until the source ends. Never drops a frame: the source waits for a free slot. What the
  /// source or the publisher throws ends the run and is thrown on, once all threads are joined.
  RunReport run(FrameSource& source, const Publisher& publisher, const RunOptions& options);

 private:
  class Feed;
  void run_inline(Feed& feed, const Publisher& publisher);
  void run_per_stage(Feed& feed, const Publisher& publisher);
  void publish(FrameSlot& slot, const Publisher& publisher);

  const Plan& plan_;
  PipelineOptions options_;
  std::vector<std::unique_ptr<FrameSlot>> slots_;
  RunReport report_;
  std::optional<std::int64_t> last_sequence_;
};

}  // namespace curlew
