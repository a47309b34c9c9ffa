// A ZernikePupil is the disc or annulus over which Zernike polynomials are normalised.
#pragma once

#include <cstdint>

#include "core/image.h"

namespace curlew {

struct ZernikePupil {
  double x = 0.0;  ///< centre, lenslet units
  double y = 0.0;
  double radius = 1.0;       ///< pitches
  double obscuration = 0.0;  ///< inner radius over radius; 0 for a disc
};

/// Returns the pupil of a sensor's lit lenslets. Its centre is that of the rectangle round them,
/// and its radius half the rectangle's longer side. If lenslets light over 90 % of the rectangle
/// they are taken for a square pupil, whose disc goes through the rectangle's corners. The central
/// hole is the disc with the area of the unlit lenslets that are nearer to the centre than any lit
/// one.
///
/// valid: [rows, cols], non-zero where a lenslet is lit; at least one is.
ZernikePupil find_zernike_pupil(const Image<std::uint8_t>& valid);

}  // namespace curlew
