// Stages: the way of a frame, in one table. Live, replay, tests and benchmarks all run this.
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "centroiding/centroid.h"
#include "centroiding/sensor.h"
#include "centroiding/slopes.h"
#include "core/frame.h"
#include "core/hodge_split.h"
#include "core/slope_field.h"
#include "core/vortex.h"
#include "detect/tracking/vortex_tracker.h"
#include "reconstruct/hidden_phase.h"
#include "reconstruct/split.h"
#include "service/config.h"
#include "service/vortex_detection.h"

namespace curlew {

/// All that follows from the sensor, the frames' format and the configuration. Const and shared.
struct Plan {
  Plan(const Sensor& sensor, const FrameFormat& format, const Config& config);
  Plan(const Plan&) = delete;
  Plan& operator=(const Plan&) = delete;

  LensletGrid grid;
  std::optional<TrackerOptions> tracker;  ///< none: every frame stands alone
  CentroidPlan centroid;
  SlopePlan slopes;
  VortexDetectionPlan detect;
  SplitPlan split;
  std::optional<HiddenPhasePlan> hidden_phase;  ///< refers to `split`
};

inline constexpr std::size_t kStageCount = 6;

/// How long a frame took, in ns: one figure a stage, in the order of kStages.
struct FrameLatency {
  std::array<std::int64_t, kStageCount> stage_ns{};
  std::int64_t publish_ns = 0;
  std::int64_t total_ns = 0;  ///< received → all results ready to publish
};

/// Every buffer of one frame's results, made once. The frame itself is lent by the feed.
struct FrameSlot {
  /// frames_tracker: of all slots of the plan, where it tracks; only the stage that tracks, which
  /// takes frames in their order, touches it.
  explicit FrameSlot(const Plan& plan_of_slot, VortexTracker* frames_tracker = nullptr);

  const Plan* plan;              ///< what the frame is worked on by
  VortexTracker* tracker;        ///< none: every frame stands alone
  std::int64_t frame_index = 0;  ///< counts from 0 over all that the feed gives
  FrameBuffer* frame = nullptr;
  Centroids centroids;
  SlopeField slopes;
  SlopeField weak_slopes;  ///< those too that are too noisy to be split
  VortexDetectionWorkspace detect_workspace;
  CirculationMap circulation;  ///< of weak_slopes
  VortexList candidates;
  VortexList tracked;  ///< empty where nothing is tracked
  VortexList vortices;
  SplitWorkspace split_workspace;
  HodgeSplit split;
  std::optional<HiddenPhaseWorkspace> hidden_phase_workspace;
  Image<float> whole_phase;  ///< rad; empty where the plan does not ask for it
  FrameLatency latency;
};

struct Stage {
  const char* name;  ///< as in the reports and, in capitals, in the LATENCY table
  void (*run)(const Plan&, FrameSlot&) noexcept;  ///< the plan is the slot's
};

extern const std::array<Stage, kStageCount> kStages;

}  // namespace curlew
