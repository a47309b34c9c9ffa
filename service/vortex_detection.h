// Vortex detection by the configured method: one plan, one workspace, one call.
#pragma once

#include <cstddef>
#include <optional>

#include "centroiding/frame_level.h"
#include "centroiding/sensor.h"
#include "core/centroids.h"
#include "core/frame.h"
#include "core/slope_field.h"
#include "core/vortex.h"
#include "detect/circulation_finder.h"
#include "detect/classifier/vortex_classifier.h"
#include "detect/whitened/whitened_finder.h"
#include "service/config.h"
#include "service/method_choice.h"

namespace curlew {

/// It is const after construction and shared by threads.
class VortexDetectionPlan {
 public:
  /// Throws what the plan of the method throws, and UsageError if the method does not suit the
  /// sensor.
  VortexDetectionPlan(const Sensor& sensor, const FrameFormat& format, const Config& config);

  /// Returns the method that is used, and why it was chosen.
  const MethodChoice& choice() const { return choice_; }
  /// Candidates that are less probable than this are not reported as vortices.
  double min_probability() const { return min_probability_; }
  const CirculationPlan& circulation() const { return circulation_; }
  const std::optional<WhitenedPlan>& whitened() const { return whitened_; }
  const std::optional<ClassifierPlan>& classifier() const { return classifier_; }
  /// capacity() is the most vortices a frame can have. There can be more candidates, because tracks
  /// and the hidden phase take improbable ones too.
  std::size_t capacity() const { return circulation_.capacity(); }
  std::size_t candidate_capacity() const { return candidate_capacity_; }

 private:
  MethodChoice choice_;
  double min_probability_;
  std::size_t candidate_capacity_;
  CirculationPlan circulation_;
  std::optional<WhitenedPlan> whitened_;
  std::optional<ClassifierPlan> classifier_;
};

/// The buffers of one frame, made once.
struct VortexDetectionWorkspace {
  explicit VortexDetectionWorkspace(const VortexDetectionPlan& plan);

  /// Returns whether no vortex was looked for, because the classifier does not know such wide
  /// spots.
  bool spots_are_too_wide() const { return classifier && classifier->judged.coding == nullptr; }

  std::optional<WhitenedWorkspace> whitened;
  std::optional<ClassifierWorkspace> classifier;
};

/// Says whether two plans for one sensor differ at most in how many false alarms they allow to the
/// whitened filter.
bool filter_alike(const VortexDetectionPlan& a, const VortexDetectionPlan& b);

/// Exchanges what the filter made of a frame, where there is one.
void exchange_filtered(VortexDetectionWorkspace& a, VortexDetectionWorkspace& b) noexcept;

/// Finds the candidates of one frame and fills `candidates` anew. Never allocates. levels: those
/// that the centroids were measured with, or null. slopes: must include weak ones
/// (measure_weak_slopes); circulation: theirs.
void detect_candidates(const VortexDetectionPlan& plan, FrameView frame, const FrameLevels* levels,
                       const Centroids& centroids, const SlopeField& slopes,
                       const CirculationMap& circulation, VortexDetectionWorkspace& workspace,
                       VortexList& candidates) noexcept;

/// Chooses the candidates that are probable enough to be reported, where nothing is tracked.
void choose_probable(const VortexDetectionPlan& plan, const VortexList& candidates,
                     VortexList& vortices) noexcept;

}  // namespace curlew
