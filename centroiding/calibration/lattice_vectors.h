// This file declares the lattice vectors: the period of a picture of spots, from its
// autocorrelation.
#pragma once

#include <array>

#include "centroiding/calibration/spot_picture.h"

namespace curlew {

enum class LatticeKind { kSquare, kHexagonal, kOther };

/// These are the two shortest independent vectors that map the picture onto itself, in px.
struct LatticeVectors {
  std::array<double, 2> a{};  ///< the shorter one
  std::array<double, 2> b{};
  LatticeKind kind = LatticeKind::kOther;

  double length_ratio() const;  ///< |b| / |a|
  double angle_deg() const;     ///< angle between a and b: 60 to 90 where b is the shortest choice
};

/// Finds the lattice vectors of a picture. Every pair of spots a lattice vector apart adds to the
/// autocorrelation there, so that the vector stands out of noise, of hot pixels and of missing
/// spots. Brightness is compressed (asinh) first, so that a few bright spots do not decide. Throws
/// Failure where the picture is too small, where nothing repeats, or where it repeats in one
/// direction only.
LatticeVectors find_lattice_vectors(const SpotPicture& picture);

}  // namespace curlew
