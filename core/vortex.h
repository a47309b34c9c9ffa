// Circulation and vortices are what detection makes of a slope field.
#pragma once

#include <cstdint>

#include "core/fixed_list.h"
#include "core/image.h"

namespace curlew {

/// Holds the circulation D of each cell, [rows-1, cols-1] for [rows, cols] lenslets, in radians.
/// Where valid is 0 the other maps hold 0 and mean nothing.
struct CirculationMap {
  CirculationMap(int lenslet_rows, int lenslet_cols)
      : value(lenslet_rows - 1, lenslet_cols - 1),
        variance(lenslet_rows - 1, lenslet_cols - 1),
        valid(lenslet_rows - 1, lenslet_cols - 1) {}

  Image<float> value;     ///< rad
  Image<float> variance;  ///< rad², propagated from the slopes' variances
  Image<std::uint8_t> valid;
  int n_valid = 0;
};

/// These are the bits of Vortex::flags.
enum VortexFlag : std::uint32_t {
  kVortexAtPupilEdge = 1,     ///< a cell of its 3×3 neighbourhood lies outside the pupil
  kVortexAtHole = 2,          ///< a cell of its 3×3 neighbourhood is lost to a missing lenslet
  kVortexUnresolvedPair = 4,  ///< two opposite vortices too near each other to be told apart
  kVortexPredicted = 8,       ///< not seen in this frame; it is placed where its track should be
};

/// Stands for a probability that the detector does not know.
inline constexpr float kUnknownProbability = -1.0F;

struct Vortex {
  float x = 0;  ///< lenslet units: cell (r, c) is centred at (c+½, r+½)
  float y = 0;
  std::int32_t charge = 0;  ///< +1 or −1; 0 for an unresolved pair, which lies midway
  float circulation = 0;    ///< D of its cell, rad
  float significance = 0;   ///< |D| over its standard deviation
  float probability = kUnknownProbability;  ///< that a vortex of this charge lies within .75 pitch
  float variance_x = 0;                     ///< variance of the position, pitches²; 0 if unknown
  float variance_y = 0;
  float covariance_xy = 0;
  float velocity_x = 0;  ///< velocity of its track, pitches a second (a frame if no clock is known)
  float velocity_y = 0;
  std::uint32_t flags = 0;
  std::int64_t track = -1;  ///< number of its track; −1 if not tracked
};

using VortexList = FixedList<Vortex>;

}  // namespace curlew
