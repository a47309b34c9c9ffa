// Light in a lenslet's window that is not its spot's: ghosts, reflections and clumps of hot pixels.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "centroiding/centroid.h"
#include "centroiding/frame_level.h"
#include "centroiding/sensor.h"
#include "core/centroids.h"
#include "core/image.h"

namespace curlew {

/// Finds such light in the frames of one sensor. It has no state but its buffers.
///
/// Two things show it, and neither of them is what a vortex does to a spot, which it darkens and
/// draws apart:
///
/// - Light that lies round the spot as well. The corners between the lenslets are brighter than the
///   level that holds for the lenslets round about, or those on one side than those on the other,
///   by so much that it may pull the spot by more than .05 px and by more than three times its
///   noise.
/// - A spot that is brighter than the others of the frame, and wider or longer than they are by far
///   more than these differ among themselves.
class ForeignLight {
 public:
  ForeignLight(const Sensor& sensor, const CentroidPlan& plan);

  /// Marks lenslets with such light as kLost. Sets row_changed, [rows], to 1 where a row has one.
  /// The levels and centroids must be those of one frame. Never allocates.
  void mark(const FrameLevels& levels, Centroids& centroids,
            std::vector<std::uint8_t>& row_changed) noexcept;

 private:
  /// What the spots of a frame have in common, and how far they differ.
  struct Usual {
    float brightest;    ///< flux over its reference's
    float widest_px2;   ///< second moments, x and y together
    float longest_px2;  ///< by how much they differ between axes
  };
  Usual usual(const Centroids& centroids) noexcept;

  float adu_per_count_;
  Image<float> reference_flux_adu_;
  Image<float> pull_;  ///< px that a count of such light pulls a spot of an ADU
  std::vector<std::size_t> sample_;
  std::vector<float> values_;  ///< [sample] a buffer
};

}  // namespace curlew
