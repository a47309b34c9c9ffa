#include "service/sweep/sweep.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <set>
#include <utility>

#include "core/error.h"
#include "core/stage_timer.h"
#include "service/method_choice.h"
#include "service/vortex_detection.h"

namespace curlew {
namespace {

// Places in kStages.
constexpr std::size_t kCentroid = 0;
constexpr std::size_t kSlopes = 1;
constexpr std::size_t kSplit = 4;

/// Exchanges what the stages centroid and slopes made of a frame, and its circulation.
void exchange_slopes(FrameSlot& a, FrameSlot& b) noexcept {
  std::swap(a.levels, b.levels);
  std::swap(a.sharp, b.sharp);
  std::swap(a.follow_state, b.follow_state);
  std::swap(a.centroids, b.centroids);
  std::swap(a.slopes, b.slopes);
  std::swap(a.weak_slopes, b.weak_slopes);
  std::swap(a.circulation, b.circulation);
}

/// Exchanges what the split made of a frame, and what the hidden phase of `a` needs of it.
void exchange_split(FrameSlot& a, FrameSlot& b) noexcept {
  if (a.hidden_phase_workspace) std::swap(a.split_workspace, b.split_workspace);
  std::swap(a.split, b.split);
}

}  // namespace

std::string sweep_output(const std::string& out, const std::string& name) {
  const std::size_t slash = out.rfind('/');
  const std::size_t file = slash == std::string::npos ? 0 : slash + 1;
  const std::size_t dot = out.find(".fits", file);
  if (dot == std::string::npos) return out + "." + name;
  return out.substr(0, dot) + "." + name + out.substr(dot);
}

void Sweep::Count::add(const FrameSlot& slot) {
  ++frames;
  vortices += static_cast<std::int64_t>(slot.vortices.size());
  measured += slot.centroids.n_valid;
}

Sweep::Run Sweep::make_run(const NamedConfig& config, const Sensor& sensor,
                           const FrameFormat& format) {
  Run run;
  run.plan = std::make_unique<const Plan>(sensor, format, config.config);
  const Plan& plan = *run.plan;
  if (plan.follower) run.follower = std::make_unique<WindowFollower>(*plan.follower);
  if (plan.tracker) {
    run.tracker = std::make_unique<VortexTracker>(*plan.tracker, plan.grid.rows, plan.grid.cols,
                                                  plan.detect.candidate_capacity());
    run.tracker->number_from(0);
  }
  run.slot = std::make_unique<FrameSlot>(plan, run.follower.get(), run.tracker.get());
  return run;
}

Sweep::Sweep(const std::vector<NamedConfig>& configs, const Plan& first, const Sensor& sensor,
             const FrameFormat& format, const SaveOptions& save, const std::string& out,
             std::int64_t frames) {
  first_.name = configs.front().name;
  first_.path = sweep_output(out, first_.name);
  for (std::size_t i = 1; i < configs.size(); ++i) {
    Run run = make_run(configs[i], sensor, format);
    run.count.name = configs[i].name;
    run.count.path = sweep_output(out, run.count.name);
    run.file = std::make_unique<ResultsFile>(run.count.path, *run.plan, save, frames);
    for (std::size_t j = 0; j < i; ++j) {
      const Plan& earlier = j == 0 ? first : *runs_[j - 1].plan;
      const std::set<std::string> changed = changed_sections(earlier.config, run.plan->config);
      if (changed.contains("centroid")) continue;
      if (!run.centroids_of) run.centroids_of = j;
      if (!run.filter_of && filter_alike(earlier.detect, run.plan->detect)) run.filter_of = j;
      if (!run.split_of && !changed.contains("split")) run.split_of = j;
    }
    // Nobody changes these; what is lent is circulated already.
    if (run.centroids_of) std::fill(run.slot->row_due.begin(), run.slot->row_due.end(), 0);
    if (run.filter_of) run.slot->detect_workspace.whitened->is_filled = true;
    runs_.push_back(std::move(run));
  }
}

void Sweep::run_stages(Run& run, bool saturated_before) {
  FrameSlot& slot = *run.slot;
  FrameHeader& header = slot.frame->header;
  const auto status = header.status;
  if (!run.centroids_of && !saturated_before) header.status &= ~kFrameSaturated;
  for (std::size_t stage = 0; stage < kStageCount; ++stage) {
    if (run.centroids_of && (stage == kCentroid || stage == kSlopes)) continue;
    if (run.split_of && stage == kSplit) continue;
    const StageTimer timer(slot.latency.stage_ns[stage]);
    kStages[stage].run(*slot.plan, slot);
  }
  run.file->add(slot);
  run.file->add_latency(slot);
  run.count.add(slot);
  header.status = status;
}

void Sweep::work(FrameSlot& first) {
  first_.add(first);
  // The bit is the frame's own where the first configuration did not set it.
  const bool saturated_before =
      (first.frame->header.status & kFrameSaturated) != 0 && first.centroids.n_saturated == 0;
  for (Run& run : runs_) {
    FrameSlot& slot = *run.slot;
    slot.frame = first.frame;
    slot.frame_index = first.frame_index;
    slot.latency = first.latency;
    exchange_shared(run, first);
    run_stages(run, saturated_before);
    exchange_shared(run, first);
  }
}

FrameSlot& Sweep::slot_of(std::size_t run, FrameSlot& first) const {
  return run == 0 ? first : *runs_[run - 1].slot;
}

void Sweep::exchange_shared(Run& run, FrameSlot& first) const noexcept {
  FrameSlot& slot = *run.slot;
  if (run.centroids_of) exchange_slopes(slot, slot_of(*run.centroids_of, first));
  if (run.filter_of)
    exchange_filtered(slot.detect_workspace, slot_of(*run.filter_of, first).detect_workspace);
  if (run.split_of) exchange_split(slot, slot_of(*run.split_of, first));
}

void Sweep::commit() {
  for (Run& run : runs_) run.file->commit();
}

std::string Sweep::text() const {
  std::string table =
      fmt::format("{:<24} {:>8} {:>10}  {}\n", "configuration", "frames", "vortices", "results");
  const auto add = [&](const Count& count) {
    table += fmt::format("{:<24} {:>8} {:>10}  {}\n", count.name, count.frames,
                         count.measured > 0 ? fmt::format("{}", count.vortices) : "not measured",
                         count.path);
  };
  add(first_);
  for (const Run& run : runs_) add(run.count);
  return table;
}

std::string Sweep::without_measurement() const {
  if (first_.frames > 0 && first_.measured == 0) return first_.name;
  for (const Run& run : runs_)
    if (run.count.frames > 0 && run.count.measured == 0) return run.count.name;
  return {};
}

}  // namespace curlew
