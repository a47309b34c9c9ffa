// The accurate detector: a small trained network looks at the spots round every likely node.
#pragma once

#include <cstddef>
#include <cstdint>

#include "core/centroids.h"
#include "core/fixed_list.h"
#include "core/frame.h"
#include "core/image.h"
#include "core/vortex.h"
#include "detect/classifier_network.h"
#include "detect/spot_features.h"

namespace curlew {

struct ClassifierOptions {
  double min_probability = 0.5;  ///< less likely vortices are not reported; in (0, 1)
  /// Nodes that the scout gives less, a logit, are not judged. −1e20: all that a first glance
  /// leaves are; −1e30: every one is.
  double min_scout = -2.0;
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
  /// The encoding of a lenslet that is not there, [ClassifierNetwork::kCode].
  const float* missing_code() const { return missing_code_.data(); }

 private:
  ClassifierOptions options_;
  SpotFeatures features_;
  ClassifierNetwork network_;
  float pixels_per_lambda_w_;
  AlignedVector<float> missing_code_;
};

/// A vortex seen from one node, before those seen twice are made one.
struct NodeVortex {
  Vortex vortex;
  float precision = 0;  ///< 1 / mean variance of the position
  std::int32_t row = 0;
  std::int32_t col = 0;
};

/// Buffers of one frame, made once.
struct ClassifierWorkspace {
  explicit ClassifierWorkspace(const ClassifierPlan& plan);

  static constexpr int kChunk = 48;  ///< lenslets or nodes that go through a layer together

  Image<float> brightness;        ///< [rows, cols]: fourth root of the flux over the mean
  Image<float> spread;            ///< [rows, cols]: second moments, (λ/w)²
  AlignedVector<float> interest;  ///< of a row of nodes
  Image<float> codes;             ///< [rows + 2, (cols + 2)·kCode], one lenslet wider all round
  Image<std::uint8_t> wanted;     ///< [rows, cols]: lenslets near a node that is looked at
  FixedList<std::int32_t> nodes;  ///< looked at, row·(cols − 1) + col
  FixedList<std::int32_t> lenslets;
  AlignedVector<float> a;  ///< a chunk between layers
  AlignedVector<float> b;
  FixedList<NodeVortex> seen;
  Image<std::int32_t> seen_at;  ///< [2·(rows − 1), cols − 1], both signs: index into seen, or −1
};

/// Vortices of one frame, the surest first; `vortices` is cleared first. Never allocates.
/// A lenslet that is unlit, saturated or has bad pixels is missing; faint spots and those at the
/// window's edge are not, their pixels count.
void classify_vortices(const ClassifierPlan& plan, FrameView frame, const Centroids& centroids,
                       const CirculationMap& circulation, ClassifierWorkspace& workspace,
                       VortexList& vortices) noexcept;

/// The scout's inputs for node (row, col), [kScoutFeatures]: |D|, D of the eight nodes around
/// relative to its sign, brightness and spread of the four lenslets, σ_D, 1. The workspace as
/// classify_vortices leaves it.
void describe_node(const ClassifierWorkspace& workspace, const CirculationMap& circulation, int row,
                   int col, float* to) noexcept;

}  // namespace curlew
