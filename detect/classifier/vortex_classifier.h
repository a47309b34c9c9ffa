// The accurate detector: a small trained network looks at the spots round every likely node.
#pragma once

#include <cstddef>
#include <cstdint>

#include "core/centroids.h"
#include "core/fixed_list.h"
#include "core/frame.h"
#include "core/image.h"
#include "core/vortex.h"
#include "detect/classifier/classifier_network.h"
#include "detect/classifier/patch_layer.h"
#include "detect/classifier/spot_features.h"
#include "detect/classifier/vortex_scout.h"
#include "detect/classifier/vortex_views.h"

namespace curlew {

inline constexpr double kEveryNode = -1e29;

struct ClassifierOptions {
  double min_probability = 0.5;  ///< less likely vortices are not reported; in (0, 1)
  /// Nodes that the scout gives less, a logit, are not judged. Below kEveryNode it stops none.
  double min_scout = -2.0;
  /// Nor those that the screen gives less, likewise.
  double min_screen = -2.5;
  /// Sums in the order and to the precision of the training, and no screen; slower. Probabilities
  /// differ by less than .01, but where a spot's signal is not above 0 and its noise not known.
  bool as_trained = false;
};

/// All that follows from sensor, frame format, options and network. Const after construction.
class ClassifierPlan {
 public:
  /// Throws UsageError on options out of range and Failure as SpotFeatures does, and on fewer than
  /// 2×2 lenslets.
  ClassifierPlan(const ClassifierOptions& options, const SpotCamera& camera,
                 const FrameFormat& format,
                 ClassifierNetwork network = shipped_classifier_network());

  const ClassifierOptions& options() const { return options_; }
  const SpotFeatures& features() const { return features_; }
  const ClassifierNetwork& network() const { return network_; }
  int rows() const { return features_.rows(); }  ///< lenslets
  int cols() const { return features_.cols(); }
  float pixels_per_lambda_w() const { return pixels_per_lambda_w_; }
  /// The first layers of head and screen in fixed point.
  const PatchLayer& judging() const { return judging_; }
  const PatchLayer& screening() const { return screening_; }
  /// The encoding of a lenslet that is not there, [ClassifierNetwork::kCode].
  const float* missing_code() const { return missing_code_.data(); }
  const std::int16_t* missing_rounded() const { return missing_rounded_.data(); }
  /// Whether nodes are screened before they are judged.
  bool screens() const { return options_.min_screen > kEveryNode && !options_.as_trained; }

 private:
  ClassifierOptions options_;
  SpotFeatures features_;
  ClassifierNetwork network_;
  PatchLayer judging_;
  PatchLayer screening_;
  float pixels_per_lambda_w_;
  AlignedVector<float> missing_code_;
  AlignedVector<std::int16_t> missing_rounded_;
};

/// Buffers of one frame, made once. Padded maps are one lenslet wider all round.
struct ClassifierWorkspace {
  explicit ClassifierWorkspace(const ClassifierPlan& plan);

  static constexpr int kChunk = 48;  ///< lenslets or nodes that go through a layer together

  ScoutWorkspace scout;
  Image<std::int16_t> codes;         ///< padded, [rows + 2, (cols + 2)·kCode], in 1/kCodeSteps
  Image<float> exact_codes;          ///< the same as floats, where options.as_trained
  Image<std::uint8_t> wanted;        ///< padded, and to 8 columns: 1 wanted, 3 listed
  FixedList<std::int32_t> nodes;     ///< judged, row·(cols − 1) + col
  FixedList<std::int32_t> lenslets;  ///< encoded last
  int encoded = 0;                   ///< lenslets, in all
  AlignedVector<float> a;            ///< a chunk between layers
  AlignedVector<float> b;
  AlignedVector<float> exponentials;  ///< of what the head says of a chunk
  VortexViews views;
};

/// Vortices of one frame, the surest first; `vortices` is cleared first. Never allocates.
/// An opposite pair nearer than about a pitch is one entry of charge 0 with kVortexUnresolvedPair,
/// where that is likelier than either of the two alone. Its probability is that of such a pair.
/// Lenslets that is_missing (vortex_scout.h) are left out, and nodes with two or more of those
/// among their four.
void find_classified_vortices(const ClassifierPlan& plan, FrameView frame,
                              const Centroids& centroids, const CirculationMap& circulation,
                              ClassifierWorkspace& workspace, VortexList& vortices) noexcept;

}  // namespace curlew
