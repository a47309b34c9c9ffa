#include "service/vortex_detection.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "service/spot_camera.h"

namespace curlew {
namespace {

/// Tracks and the hidden phase take candidates down to this probability.
constexpr double kCandidateProbability = 0.02;

/// Returns how the frame differs from the calibration, which the centroids were measured with.
FrameShift shift_of(const FrameLevels* levels, const Centroids& centroids) noexcept {
  FrameShift shift{.spots_x_px = &centroids.low_x_px,
                   .spots_y_px = &centroids.low_y_px,
                   .windows_x_px = &centroids.moved_x_px,
                   .windows_y_px = &centroids.moved_y_px};
  if (levels == nullptr) return shift;
  shift.level_counts = &levels->level;
  shift.noise_counts = std::sqrt(levels->pixel_variance);
  return shift;
}

}  // namespace

VortexDetectionPlan::VortexDetectionPlan(const Sensor& sensor, const FrameFormat& format,
                                         const Config& config)
    : choice_(choose_method(sensor, config)),
      min_probability_(config.detect.min_probability),
      candidate_capacity_(std::min(4 * config.pipeline.max_vortices, 2 * sensor.valid.size())),
      circulation_(config.detect, sensor.valid,
                   std::min(config.pipeline.max_vortices, sensor.valid.size())) {
  const bool unlikely_too = config.track.enabled || config.split.hidden_phase;
  const double min_probability =
      unlikely_too ? std::min(kCandidateProbability, min_probability_) : min_probability_;
  if (choice_.method == DetectMethod::kClassifier) {
    ClassifierOptions classifier{.min_probability = min_probability};
    if (!config.detect.review) classifier.min_review = kNoNode;
    classifier_.emplace(classifier, spot_camera(sensor), format);
  } else if (choice_.method == DetectMethod::kWhitened) {
    WhitenedOptions whitened;
    whitened.false_alarms_per_frame = config.detect.false_alarms_per_frame;
    whitened.min_probability = min_probability;
    whitened_.emplace(whitened, sensor.valid, candidate_capacity_);
  }
}

VortexDetectionWorkspace::VortexDetectionWorkspace(const VortexDetectionPlan& plan) {
  if (plan.whitened()) whitened.emplace(*plan.whitened());
  if (plan.classifier()) classifier.emplace(*plan.classifier());
}

bool filter_alike(const VortexDetectionPlan& a, const VortexDetectionPlan& b) {
  return a.whitened() && b.whitened() && filter_alike(*a.whitened(), *b.whitened());
}

void exchange_filtered(VortexDetectionWorkspace& a, VortexDetectionWorkspace& b) noexcept {
  if (!a.whitened || !b.whitened) return;
  std::swap(a.whitened->lit, b.whitened->lit);
  std::swap(a.whitened->planes, b.whitened->planes);
}

void detect_candidates(const VortexDetectionPlan& plan, FrameView frame, const FrameLevels* levels,
                       const Centroids& centroids, const SlopeField& slopes,
                       const CirculationMap& circulation, VortexDetectionWorkspace& workspace,
                       VortexList& candidates) noexcept {
  if (plan.classifier() && workspace.classifier) {
    find_classified_vortices(*plan.classifier(), frame, shift_of(levels, centroids), centroids,
                             circulation, *workspace.classifier, candidates);
  } else if (plan.whitened() && workspace.whitened) {
    const Image<std::uint8_t>& lenslets = plan.whitened()->lenslet_valid();
    for (std::size_t k = 0; k < lenslets.size() && !workspace.whitened->is_filled; ++k)
      workspace.whitened->lit[k] =
          lenslets[k] != 0 && centroids.state[k] != LensletState::kLost ? 1 : 0;
    find_whitened_vortices(*plan.whitened(), slopes, centroids.flux_adu, circulation,
                           *workspace.whitened, candidates);
  } else {
    find_circulation_vortices(plan.circulation(), circulation, candidates);
  }
}

void choose_probable(const VortexDetectionPlan& plan, const VortexList& candidates,
                     VortexList& vortices) noexcept {
  const auto minimum = static_cast<float>(plan.min_probability());
  vortices.clear();
  vortices.add_overflow(candidates.overflow());
  for (const Vortex& candidate : candidates)
    if (candidate.probability == kUnknownProbability || candidate.probability >= minimum)
      vortices.push(candidate);
}

}  // namespace curlew
