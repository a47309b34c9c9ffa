// This file declares the accurate detector, `classifier`: a small trained network looks at the
// spots round every likely node, and a larger one where that sees something.
#pragma once

#include <cstddef>
#include <cstdint>

#include "core/centroids.h"
#include "core/fixed_list.h"
#include "core/frame.h"
#include "core/image.h"
#include "core/vortex.h"
#include "detect/classifier/classifier_network.h"
#include "detect/classifier/lit_nodes.h"
#include "detect/classifier/patch_judge.h"
#include "detect/classifier/patch_layer.h"
#include "detect/classifier/spot_features.h"
#include "detect/classifier/vortex_scout.h"
#include "detect/classifier/vortex_views.h"

namespace curlew {

inline constexpr double kEveryNode = -1e29;
inline constexpr double kNoNode = 1e29;

struct ClassifierOptions {
  double min_probability = 0.5;  ///< less likely vortices are not reported; in (0, 1)
  /// Nodes to which the scout gives a lower logit than this are not judged. At kEveryNode or below,
  /// the scout stops none.
  double min_scout = -2.0;
  /// Nodes to which the screen gives a lower logit than this are not judged. At kEveryNode or
  /// below, there is no screen.
  double min_screen = -2.5;
  /// Nodes to which the judge gives a higher logit for a vortex or a pair are reviewed: the answer
  /// is then the mean of the judge's and the reviewer's. At kNoNode or above, none is reviewed.
  double min_review = -2.0;
  /// If true, the classifier sums in the order and to the precision of the training and has no
  /// screen, which is slower. Probabilities differ by less than .01, except where a spot's signal
  /// is not above 0 and its noise is not known, and where a logit of the judge is just at
  /// min_review, so that the reviewer is asked in one of the two cases only.
  bool as_trained = false;
};

/// The plan holds all that follows from sensor, frame format, options and network. It is const
/// after construction.
class ClassifierPlan {
 public:
  /// Throws UsageError where an option is out of its range, and Failure as SpotFeatures does and
  /// where there are fewer than 2×2 lenslets.
  ClassifierPlan(const ClassifierOptions& options, const SpotCamera& camera,
                 const FrameFormat& format,
                 ClassifierNetwork network = shipped_classifier_network());

  const ClassifierOptions& options() const { return options_; }
  const SpotFeatures& features() const { return features_; }
  const ClassifierNetwork& network() const { return network_; }
  int rows() const { return features_.rows(); }  ///< in lenslets
  int cols() const { return features_.cols(); }
  float pixels_per_lambda_w() const { return pixels_per_lambda_w_; }
  const PatchJudge& judge() const { return judge_; }
  const PatchJudge& reviewer() const { return reviewer_; }
  /// Returns the first layer of the screen in fixed point.
  const PatchLayer& screening() const { return screening_; }
  /// Returns whether nodes are screened before they are judged.
  bool screens() const { return options_.min_screen > kEveryNode && !options_.as_trained; }

 private:
  ClassifierOptions options_;
  SpotFeatures features_;
  ClassifierNetwork network_;
  PatchJudge judge_;
  PatchJudge reviewer_;
  PatchLayer screening_;
  float pixels_per_lambda_w_;
};

/// These are the buffers of one frame, made once.
struct ClassifierWorkspace {
  explicit ClassifierWorkspace(const ClassifierPlan& plan);

  ScoutWorkspace scout;
  SpotCodes judged;        ///< the spots' codes for the judge
  SpotCodes reviewed;      ///< and for the reviewer
  MeasuredSpots measured;  ///< by the judge, for both
  /// One lenslet wider all round, and to a multiple of 8 columns: 1 wanted, 3 listed.
  Image<std::uint8_t> wanted;
  FixedList<std::int32_t> lenslets;   ///< lenslets encoded last
  FixedList<std::int32_t> nodes;      ///< nodes to be judged, row·(cols − 1) + col
  FixedList<std::int32_t> to_review;  ///< those that are reviewed
  FixedList<std::int32_t> places;     ///< where these stand in `nodes`
  AlignedVector<float> answers;       ///< [nodes, two NodeOutput and a PairOutput]
  AlignedVector<float> exponentials;  ///< of the answers
  LayerBuffers buffers;
  VortexViews views;
  LitNodes lit;
};

/// Finds the vortices of one frame, the surest first; `vortices` is cleared first. It never
/// allocates. `shift` says how level, noise and places of the spots differ from the calibration. An
/// opposite pair nearer than about a pitch is one entry of charge 0 with kVortexUnresolvedPair
/// where that is likelier than either of the two alone; its probability is that of such a pair.
/// Where the spots are wider than those of the calibration, the encoders are told so; where they
/// are wider than these were taught, nothing is found, and workspace.judged.coding is null.
/// Lenslets that are missing by is_missing() (vortex_scout.h) are left out. So are nodes of which
/// two or more of the four lenslets are missing, or one that is not alone: over 3 of the 16 round
/// them.
void find_classified_vortices(const ClassifierPlan& plan, FrameView frame, const FrameShift& shift,
                              const Centroids& centroids, const CirculationMap& circulation,
                              ClassifierWorkspace& workspace, VortexList& vortices) noexcept;

}  // namespace curlew
