// The lessons of the vortex classifier: nodes of fresh exposures, turned, in random order.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "acquisition/simulator/random_stream.h"
#include "detect/classifier/classifier_network.h"
#include "detect/classifier/spot_features.h"
#include "service/training/training_exposures.h"
#include "service/training/training_fields.h"

namespace curlew {

/// One of the eight symmetries of the square: (x, y) → (sx·x, sy·y), after a transposition if
/// `transpose`.
struct Symmetry {
  Symmetry(bool transpose_first, int sign_x, int sign_y);

  bool mirrors() const { return (sx * sy < 0) != transpose; }
  Label operator()(const Label& label) const;

  bool transpose;
  int sx;
  int sy;
  /// Index is the lenslet after, value the lenslet before.
  std::array<int, kPatchLenslets> lenslet{};
  std::array<int, kSpotFeatures> feature{};
  std::array<float, kSpotFeatures> sign{};
};

/// Returns the eight of them.
std::vector<Symmetry> all_symmetries();

class Lessons {
 public:
  /// fields: must outlive the lessons.
  Lessons(const std::vector<TrainingField>& fields, std::uint64_t seed);

  double measuring_s() const { return measuring_s_; }
  const std::array<float, kSpotFeatures>& scale() const { return scale_; }

  /// Fills the inputs of one node, [kPatchLenslets, kTaughtInputs], the features times scale(), and
  /// returns its label.
  NodeLabel next(float* inputs);

 private:
  struct Node {
    std::int32_t exposure, row, col;  // of the block
    float weight;
  };

  /// Draws the missing lenslets of a patch, one bit each. Now and then the array ends here, or a
  /// lenslet is missing.
  std::uint32_t draw_missing();
  void expose_anew();

  const std::vector<TrainingField>& fields_;
  RandomStream random_;
  std::vector<Symmetry> symmetries_;
  std::array<float, kSpotFeatures> scale_{};
  std::vector<Exposure> exposures_;
  std::vector<Node> nodes_;
  std::size_t next_ = 0;
  int visits_ = 0;
  double measuring_s_ = 0.0;
};

}  // namespace curlew
