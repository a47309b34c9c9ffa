// The Strehl ratio that a phase estimate would give a field, were a mirror to take it off.
#pragma once

#include <vector>

#include "core/image.h"
#include "reconstruct/vortex_field.h"
#include "service/bench/phase_field.h"

namespace curlew {

/// A phase estimate in its parts, [rows, cols] at lenslet centres, rad.
struct PhaseEstimate {
  Image<float> smooth;
  Image<float> rotational;  ///< of the vortices, with its branch cuts
  std::vector<PointVortex> vortices;
};

/// |∫U·exp(−iφ)|²/(∫|U|)² over the array, 1 where φ is the field's own phase but for a constant.
struct Strehl {
  double ideal = 0.0;   ///< the vortices' phase is arg(z − z_v) at every point of the field
  double mirror = 0.0;  ///< it is interpolated bilinearly from the lenslets: a mirror cannot jump
};

/// Between lenslets the smooth part is interpolated by cubic convolution (R. G. Keys, IEEE Trans.
/// ASSP 29, 1153, 1981), beyond the outermost centres both parts go on as odd reflections.
Strehl strehl_after(const PhaseField& field, const PhaseEstimate& estimate);

/// Without any correction.
double strehl_uncorrected(const PhaseField& field);

}  // namespace curlew
