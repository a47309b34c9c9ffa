#include "service/stages.h"

#include <algorithm>

#include "detect/circulation.h"

namespace curlew {
namespace {

void centroid(const Plan& plan, FrameSlot& slot) noexcept {
  find_centroids(plan.centroid, slot.frame->view(), slot.centroids);
  if (slot.centroids.n_saturated > 0) slot.frame->header.status |= kFrameSaturated;
}

void slopes(const Plan& plan, FrameSlot& slot) noexcept {
  measure_slopes(plan.slopes, slot.centroids, slot.slopes);
}

void detect(const Plan& plan, FrameSlot& slot) noexcept {
  circulate(slot.slopes, slot.circulation);
  find_vortices(plan.detect, slot.circulation, slot.vortices);
}

void split(const Plan& plan, FrameSlot& slot) noexcept {
  split_slopes(plan.split, slot.slopes, slot.split_workspace, slot.split);
}

}  // namespace

// Detection comes before the split: it needs only the slopes, and the split takes longest.
const std::array<Stage, kStageCount> kStages = {{
    {"centroid", centroid},
    {"slopes", slopes},
    {"detect", detect},
    {"split", split},
}};

Plan::Plan(const Sensor& sensor, const FrameFormat& format, const Config& config)
    : grid(sensor.grid),
      centroid(sensor, format, config.centroid),
      slopes(sensor),
      detect(config.detect, sensor.valid,
             std::min(config.pipeline.max_vortices, sensor.valid.size())),
      split(sensor.valid, config.split) {}

FrameSlot::FrameSlot(const Plan& plan_of_slot)
    : plan(&plan_of_slot),
      centroids(plan->grid.rows, plan->grid.cols),
      slopes(plan->grid.rows, plan->grid.cols),
      circulation(plan->grid.rows, plan->grid.cols),
      vortices(plan->detect.capacity()),
      split_workspace(plan->split),
      split(plan->grid.rows, plan->grid.cols) {}

}  // namespace curlew
