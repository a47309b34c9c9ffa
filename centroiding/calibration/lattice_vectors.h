// Lattice vectors: the period of a picture of spots, from its autocorrelation.
#pragma once

#include <array>

#include "centroiding/calibration/spot_picture.h"

namespace curlew {

enum class LatticeKind { kSquare, kHexagonal, kOther };

/// The two shortest independent vectors that map the picture onto itself, in px.
struct LatticeVectors {
  std::array<double, 2> a{};  ///< the shorter
  std::array<double, 2> b{};
  LatticeKind kind = LatticeKind::kOther;

  double length_ratio() const;  ///< |b| / |a|
  double angle_deg() const;     ///< between them, 60 to 90 where b is the shortest choice
};

/// Every pair of spots a lattice vector apart adds to the autocorrelation there, so it stands out
/// of noise, of hot pixels and of missing spots; brightness is compressed (asinh) first, so that
/// a few bright spots do not decide. Throws Failure where nothing repeats, or in one direction
/// only.
LatticeVectors find_lattice_vectors(const SpotPicture& picture);

}  // namespace curlew
