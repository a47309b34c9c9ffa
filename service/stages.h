// Stages: the steps that each frame passes, in one table. Live, replay, tests and benchmarks all
// run this table.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "centroiding/centroid.h"
#include "centroiding/frame_level.h"
#include "centroiding/sensor.h"
#include "centroiding/sharp_pixels.h"
#include "centroiding/slopes.h"
#include "centroiding/window_follower.h"
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

/// All that follows from the sensor, the format of the frames and the configuration. It is const
/// after construction and shared.
struct Plan {
  /// Throws Failure or UsageError for what does not fit together, and Failure, before anything is
  /// made, if plan and slots would take more than memory_limit_bytes().
  Plan(const Sensor& sensor, const FrameFormat& format, Config settings);
  Plan(const Plan&) = delete;
  Plan& operator=(const Plan&) = delete;

  /// What it was made from. Files that are made with the plan carry these.
  Config config;
  Optics optics;
  Detector detector;
  std::string sensor_hash;

  LensletGrid grid;
  std::optional<TrackerOptions> tracker;  ///< none: every frame is judged alone
  CentroidPlan centroid;
  // None: the level stays the calibration's, and no pixel is looked at for being sharp.
  std::optional<LevelPlan> level;
  std::optional<SharpPixelPlan> sharp;
  /// The follower before the first frame, which each set of slots copies. None: the windows stay.
  std::unique_ptr<const WindowFollower> follower;
  SlopePlan slopes;
  VortexDetectionPlan detect;
  SplitPlan split;
  std::optional<HiddenPhasePlan> hidden_phase;  ///< refers to `split`
};

inline constexpr std::size_t kStageCount = 6;

/// How long a frame took, in ns, with one figure for each stage in the order of kStages.
struct FrameLatency {
  std::array<std::int64_t, kStageCount> stage_ns{};
  std::int64_t publish_ns = 0;
  std::int64_t total_ns = 0;  ///< from received until all results are ready to be published
};

/// Every buffer of one frame's results, made once. The feed lends the frame itself.
struct FrameSlot {
  /// All slots of the plan share the follower and the tracker. Only the centroid stage touches the
  /// one and the tracking stage the other, and both take frames in their order.
  explicit FrameSlot(const Plan& plan_of_slot, WindowFollower* frames_follower = nullptr,
                     VortexTracker* frames_tracker = nullptr);

  const Plan* plan;              ///< the plan by which the frame is worked on
  WindowFollower* follower;      ///< null: the windows stay where the calibration put them
  VortexTracker* tracker;        ///< null: every frame is judged alone
  std::int64_t frame_index = 0;  ///< counts from 0 over all frames that the feed gives
  FrameBuffer* frame = nullptr;
  Team* team = nullptr;  ///< shares the centroid stage, where there is one
  /// The frame broke off while it was read out; it has no results, and stages leave it alone.
  bool broke_off = false;
  /// How many rows of lenslets measure_ahead() has carried to circulation, of a frame that is still
  /// arriving.
  int rows_ahead = 0;
  /// [rows of lenslets] 1 where slopes and circulation do not stand yet.
  std::vector<std::uint8_t> row_due;
  std::optional<FrameLevels> levels;
  std::optional<SharpPixels> sharp;
  FollowState follow_state = FollowState::kSettled;
  Centroids centroids;
  SlopeField slopes;
  /// These include weak spots, which the split does not use, and are less the low orders that the
  /// windows follow.
  SlopeField weak_slopes;
  VortexDetectionWorkspace detect_workspace;
  CirculationMap circulation;  ///< made of weak_slopes
  VortexList candidates;
  VortexList tracked;  ///< empty if nothing is tracked
  VortexList vortices;
  SplitWorkspace split_workspace;
  HodgeSplit split;
  std::optional<HiddenPhaseWorkspace> hidden_phase_workspace;
  Image<float> whole_phase;  ///< in rad; empty if the plan does not ask for it
  FrameLatency latency;
};

struct Stage {
  const char* name;  ///< stands in reports and, in capitals, in the LATENCY table
  void (*run)(const Plan&, FrameSlot&) noexcept;  ///< takes the plan of the slot
  /// Takes frames in their order. The first stage always does, and at most one other.
  bool in_order = false;
};

extern const std::array<Stage, kStageCount> kStages;

/// Measures centroids, slopes and circulation as far as the first `ready` rows of a frame allow.
/// The centroid stage calls it for a frame that was handed on before its last row; the stages then
/// go on from there, and give the bits that they give for a whole frame. Where the level follows
/// the frames and the windows do not, there is no state that could tell the level before the frame
/// is whole, and nothing is done.
void measure_ahead(const Plan& plan, FrameSlot& slot, int ready) noexcept;

}  // namespace curlew
