#include "service/vortex_detection.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

#include "core/error.h"
#include "detect/circulation.h"
#include "service/spot_camera.h"

namespace curlew {
namespace {

/// Tracks and the hidden phase take candidates down to this probability.
constexpr double kCandidateProbability = 0.02;

/// Refuses a turned grid, because the network was trained on spots along the detector's axes.
void check_rotation(const Sensor& sensor) {
  constexpr double kMaxRotation_deg = 5.0;
  if (std::abs(sensor.grid.rotation_deg()) <= kMaxRotation_deg) return;
  throw UsageError(fmt::format(
      "the lenslets are turned by {:.1f} degrees against the detector, and the classifier knows "
      "up to {}; turn the camera, or take another method in [detect]",
      sensor.grid.rotation_deg(), kMaxRotation_deg));
}

/// Refuses blurred spots, because the network was trained on sharp ones and takes blurred ones for
/// vortices.
void check_sharpness(const Sensor& sensor, double pixels_per_lambda_w) {
  constexpr double kMaxBlur = 0.3;  // in units of λ/w
  const double blur = sensor.spot_blur_px / pixels_per_lambda_w;
  if (!(blur > kMaxBlur)) return;
  throw UsageError(fmt::format(
      "the reference spots are blurred: by a Gaussian of {:.2f} lambda/w rms beyond diffraction, "
      "and the classifier knows up to {}; take the method whitened in [detect], or check the "
      "optics given to 'curlew calibrate'",
      blur, kMaxBlur));
}

}  // namespace

VortexDetectionPlan::VortexDetectionPlan(const Sensor& sensor, const FrameFormat& format,
                                         const Config& config)
    : min_probability_(config.detect.min_probability),
      candidate_capacity_(std::min(4 * config.pipeline.max_vortices, 2 * sensor.valid.size())),
      circulation_(config.detect, sensor.valid,
                   std::min(config.pipeline.max_vortices, sensor.valid.size())) {
  const bool unlikely_too = config.track.enabled || config.split.hidden_phase;
  const double min_probability =
      unlikely_too ? std::min(kCandidateProbability, min_probability_) : min_probability_;
  if (config.detect.method == DetectMethod::kClassifier) {
    const SpotCamera camera = spot_camera(sensor);
    check_rotation(sensor);
    check_sharpness(sensor, camera.pixels_per_lambda_w);
    classifier_.emplace(ClassifierOptions{.min_probability = min_probability}, camera, format);
  } else if (config.detect.method == DetectMethod::kWhitened) {
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

void detect_candidates(const VortexDetectionPlan& plan, FrameView frame, const Centroids& centroids,
                       const SlopeField& slopes, VortexDetectionWorkspace& workspace,
                       CirculationMap& circulation, VortexList& candidates) noexcept {
  circulate(slopes, circulation);
  if (plan.classifier() && workspace.classifier) {
    find_classified_vortices(*plan.classifier(), frame, centroids, circulation,
                             *workspace.classifier, candidates);
  } else if (plan.whitened() && workspace.whitened) {
    const Image<std::uint8_t>& lenslets = plan.whitened()->lenslet_valid();
    for (std::size_t k = 0; k < lenslets.size(); ++k)
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
