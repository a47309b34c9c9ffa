#include "service/stages.h"

#include <algorithm>
#include <string>
#include <utility>

#include "centroiding/cell_sample.h"
#include "centroiding/field_turn.h"
#include "centroiding/systematic_error.h"
#include "core/error.h"
#include "core/memory_limit.h"
#include "core/readout.h"
#include "detect/circulation.h"
#include "service/frame_time.h"
#include "service/sensor/sensor_file.h"

namespace curlew {
namespace {

/// Follows the readout of a frame that was handed on before its last row, and returns when it is
/// whole. Returns false if it broke off.
bool follow_readout(const Plan& plan, FrameSlot& slot) noexcept {
  int ready = slot.frame->rows_ready.load(std::memory_order_acquire);
  while (ready != kReadoutBrokeOff && ready < slot.frame->format().rows) {
    measure_ahead(plan, slot, ready);
    ready = wait_for_rows(*slot.frame, ready);
  }
  if (ready != kReadoutBrokeOff) return true;
  if (slot.follower != nullptr) slot.follower->give_up();
  slot.rows_ahead = 0;
  return false;
}

void centroid(const Plan& plan, FrameSlot& slot) noexcept {
  slot.broke_off = is_arriving(*slot.frame) && !follow_readout(plan, slot);
  if (slot.broke_off) return;
  const FrameView frame = slot.frame->view();
  const int ahead = std::exchange(slot.rows_ahead, 0);
  if (slot.follower != nullptr && plan.level && plan.sharp && slot.levels && slot.sharp) {
    slot.follow_state =
        slot.follower->measure(plan.centroid, *plan.level, *plan.sharp, frame, *slot.levels,
                               *slot.sharp, slot.centroids, slot.team);
    slot.row_due = slot.follower->row_changed();
  } else {
    std::fill(slot.row_due.begin(), slot.row_due.begin() + ahead, std::uint8_t{0});
    std::fill(slot.row_due.begin() + ahead, slot.row_due.end(), std::uint8_t{1});
    FrameConditions conditions{.team = slot.team};
    if (plan.level && plan.sharp && slot.levels && slot.sharp) {
      measure_levels(*plan.level, plan.level->pixels(), frame, *slot.levels, slot.team);
      find_sharp_pixels(*plan.sharp, plan.centroid, plan.centroid.spots, frame, *slot.levels,
                        *slot.sharp, slot.team);
      conditions.levels = &*slot.levels;
      conditions.sharp = &*slot.sharp;
    }
    find_centroids_rows(plan.centroid, frame, ahead, plan.grid.rows, slot.centroids, conditions);
    find_core_positions(plan.centroid, frame, slot.centroids, conditions);
    if (plan.centroid.core_threshold > 0.0F)
      std::fill(slot.row_due.begin(), slot.row_due.end(), std::uint8_t{1});
  }
  if (slot.centroids.n_saturated > 0) slot.frame->header.status |= kFrameSaturated;
}

/// Calls work(first, last) for every run of lenslet rows whose slopes do not stand yet.
template <typename Work>
void for_each_run_due(const FrameSlot& slot, Work work) noexcept {
  const int rows = static_cast<int>(slot.row_due.size());
  for (int first = 0; first < rows; ++first) {
    int last = first;
    while (last < rows && slot.row_due[static_cast<std::size_t>(last)] != 0) ++last;
    if (last > first) work(first, last);
    first = last;
  }
}

void slopes(const Plan& plan, FrameSlot& slot) noexcept {
  for_each_run_due(slot, [&](int first, int last) {
    measure_all_slopes_rows(plan.slopes, slot.centroids, first, last, slot.weak_slopes,
                            slot.slopes);
  });
  count_slopes(slot.weak_slopes);
  count_slopes(slot.slopes);
  CellSample sample;
  sample_cells(slot.centroids, slot.weak_slopes, sample);
  const float turn = subtract_turn(slot.centroids, sample, slot.weak_slopes);
  const float part = systematic_part(sample, slot.weak_slopes);
  add_systematic_error(plan.slopes, slot.centroids, part, slot.weak_slopes);
  add_systematic_error(plan.slopes, slot.centroids, part, slot.slopes);
  // These change all of the slopes, and so what is made of them.
  if (turn != 0.0F || part > 0.0F)
    std::fill(slot.row_due.begin(), slot.row_due.end(), std::uint8_t{1});
}

void detect(const Plan& plan, FrameSlot& slot) noexcept {
  CirculationMap& map = slot.circulation;
  for_each_run_due(slot, [&](int first, int last) {  // cells that have a lenslet of these rows
    circulate_rows(slot.weak_slopes, std::max(first - 1, 0), std::min(last, map.value.rows()), map);
  });
  map.n_valid = 0;
  for (const std::uint8_t valid : map.valid) map.n_valid += valid;
  detect_candidates(plan.detect, slot.frame->view(), slot.levels ? &*slot.levels : nullptr,
                    slot.centroids, slot.weak_slopes, map, slot.detect_workspace, slot.candidates);
}

void track(const Plan& plan, FrameSlot& slot) noexcept {
  if (slot.tracker != nullptr) {
    slot.tracked.assign(slot.candidates);
    slot.tracker->update(time_s(slot.frame->header), slot.tracked);
    slot.vortices.assign(slot.tracked);
  } else {
    choose_probable(plan.detect, slot.candidates, slot.vortices);
  }
}

void split(const Plan& plan, FrameSlot& slot) noexcept {
  split_slopes(plan.split, slot.slopes, slot.split_workspace, slot.split);
}

void hidden(const Plan& plan, FrameSlot& slot) noexcept {
  if (!plan.hidden_phase || !slot.hidden_phase_workspace) return;
  add_hidden_phase(*plan.hidden_phase, slot.candidates, slot.slopes, slot.centroids.flux_adu,
                   slot.split, slot.split_workspace, *slot.hidden_phase_workspace,
                   slot.whole_phase);
}

/// Returns the grid, if plan and slots can be made within the limit on memory.
LensletGrid affordable(const Sensor& sensor, const Config& config) {
  // Measured on squares of 200 and 400 lenslets; most of it are the factors of the split.
  constexpr double kPlan_bytes = 1600.0;
  constexpr double kSlot_bytes = 200.0;
  constexpr double kPixel_bytes = 12.0;
  const LensletGrid& grid = sensor.grid;
  const auto slots = static_cast<double>(config.pipeline.slots);
  require_memory("the plan for " + std::to_string(grid.rows) + " x " + std::to_string(grid.cols) +
                     " lenslets with " + std::to_string(config.pipeline.slots) + " slots",
                 (kPlan_bytes + kSlot_bytes * slots) * grid.rows * grid.cols +
                     kPixel_bytes * sensor.frame_rows * sensor.frame_cols);
  return grid;
}

}  // namespace

// Detection comes before the split, because it needs only the slopes and the split takes longest.
const std::array<Stage, kStageCount> kStages = {{
    {"centroid", centroid},
    {"slopes", slopes},
    {"detect", detect},
    {"track", track, true},
    {"split", split},
    {"hidden", hidden},
}};

void measure_ahead(const Plan& plan, FrameSlot& slot, int ready) noexcept {
  const FrameView frame = slot.frame->view();
  const int before = slot.rows_ahead;
  int rows = before;
  if (slot.follower != nullptr && plan.level && plan.sharp && slot.levels && slot.sharp) {
    rows = slot.follower->measure_ahead(plan.centroid, *plan.level, *plan.sharp, frame, ready,
                                        *slot.levels, *slot.sharp, slot.centroids);
  } else if (!plan.level) {
    while (rows < plan.grid.rows && plan.centroid.frame_rows_needed(rows) <= ready) ++rows;
    find_centroids_rows(plan.centroid, frame, before, rows, slot.centroids);
  }
  if (rows == before) return;
  measure_all_slopes_rows(plan.slopes, slot.centroids, before, rows, slot.weak_slopes, slot.slopes);
  circulate_rows(slot.weak_slopes, std::max(before - 1, 0), rows - 1, slot.circulation);
  slot.rows_ahead = rows;
}

Plan::Plan(const Sensor& sensor, const FrameFormat& format, Config settings)
    : config(std::move(settings)),
      optics(sensor.optics),
      detector(sensor.detector),
      sensor_hash(curlew::sensor_hash(sensor)),
      grid(affordable(sensor, config)),
      centroid(sensor, format, config.centroid),
      slopes(sensor),
      detect(sensor, format, config),
      split(sensor.valid, config.split) {
  if (config.centroid.follow_level) {
    level.emplace(sensor, centroid, config.centroid);
    sharp.emplace(sensor, format);
    // A handful of spots tells no low orders, and one of them that fades would be half of all.
    constexpr int kFewLenslets = 12;
    const auto lenslets = std::count(sensor.valid.begin(), sensor.valid.end(), 1);
    if (config.centroid.follow_windows && lenslets >= kFewLenslets)
      follower = std::make_unique<const WindowFollower>(sensor, centroid, *level, config.centroid);
  }
  // The tables for choosing vortices grow with the square of the number of candidates. Candidates
  // beyond this number are not judged; the most probable ones come first.
  constexpr std::size_t kMaxJudged = 1024;
  if (config.split.hidden_phase)
    hidden_phase.emplace(split, HiddenPhaseOptions{},
                         std::min(detect.candidate_capacity(), kMaxJudged));
  if (!config.track.enabled) return;
  // The options are checked here, where an exception can still refuse the plan. The tracker itself
  // is made later, when it is too late to refuse.
  check_tracker_options(config.track);
  if (config.detect.min_probability != DetectSettings{}.min_probability)
    throw UsageError(
        "[detect] min_probability has no effect while vortices are tracked: set [track] "
        "min_probability instead");
  tracker = config.track;
}

FrameSlot::FrameSlot(const Plan& plan_of_slot, WindowFollower* frames_follower,
                     VortexTracker* frames_tracker)
    : plan(&plan_of_slot),
      follower(frames_follower),
      tracker(frames_tracker),
      row_due(static_cast<std::size_t>(plan_of_slot.grid.rows), 1),
      centroids(plan->grid.rows, plan->grid.cols),
      slopes(plan->grid.rows, plan->grid.cols),
      weak_slopes(plan->grid.rows, plan->grid.cols),
      detect_workspace(plan->detect),
      circulation(plan->grid.rows, plan->grid.cols),
      candidates(plan->detect.candidate_capacity()),
      tracked(tracker != nullptr ? plan->detect.candidate_capacity() : 0),
      vortices(plan->detect.capacity()),
      split_workspace(plan->split),
      split(plan->grid.rows, plan->grid.cols) {
  if (plan->level) levels.emplace(*plan->level);
  if (plan->sharp) sharp.emplace(plan->grid.rows, plan->grid.cols);
  if (!plan->hidden_phase) return;
  hidden_phase_workspace.emplace(*plan->hidden_phase);
  whole_phase = Image<float>(plan->grid.rows, plan->grid.cols);
}

}  // namespace curlew
