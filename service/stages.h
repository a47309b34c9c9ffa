// Stages: the way of a frame, in one table. Live, replay, tests and benchmarks all run this.
#pragma once

#include <array>
#include <cstdint>

#include "centroiding/centroid.h"
#include "centroiding/sensor.h"
#include "centroiding/slopes.h"
#include "core/frame.h"
#include "core/hodge_split.h"
#include "core/slope_field.h"
#include "core/vortex.h"
#include "detect/vortex_finder.h"
#include "reconstruct/split.h"
#include "service/config.h"

namespace curlew {

/// All that follows from the sensor, the frames' format and the configuration. Const and shared.
struct Plan {
  Plan(const Sensor& sensor, const FrameFormat& format, const Config& config);

  LensletGrid grid;
  CentroidPlan centroid;
  SlopePlan slopes;
  DetectPlan detect;
  SplitPlan split;
};

inline constexpr std::size_t kStageCount = 4;

/// How long a frame took, in ns: one figure a stage, in the order of kStages.
struct FrameLatency {
  std::array<std::int64_t, kStageCount> stage_ns{};
  std::int64_t publish_ns = 0;
  std::int64_t total_ns = 0;  ///< received → all results ready to publish
};

/// Every buffer of one frame's results, made once. The frame itself is lent by the feed.
struct FrameSlot {
  explicit FrameSlot(const Plan& plan_of_slot);

  const Plan* plan;              ///< what the frame is worked on by
  std::int64_t frame_index = 0;  ///< counts from 0 over all that the feed gives
  FrameBuffer* frame = nullptr;
  Centroids centroids;
  SlopeField slopes;
  CirculationMap circulation;
  VortexList vortices;
  SplitWorkspace split_workspace;
  HodgeSplit split;
  FrameLatency latency;
};

struct Stage {
  const char* name;  ///< as in the reports and, in capitals, in the LATENCY table
  void (*run)(const Plan&, FrameSlot&) noexcept;  ///< the plan is the slot's
};

extern const std::array<Stage, kStageCount> kStages;

}  // namespace curlew
