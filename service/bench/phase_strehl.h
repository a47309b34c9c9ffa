// The Strehl ratio of a field after a mirror has taken off an estimate of its phase.
#pragma once

#include <vector>

#include "core/image.h"
#include "reconstruct/vortex_field.h"
#include "service/bench/phase_field.h"

namespace curlew {

/// A phase estimate in its parts, [rows, cols] at lenslet centres, rad.
struct PhaseEstimate {
  Image<float> smooth;
  Image<float> rotational;  ///< the phase of the vortices, with its branch cuts
  std::vector<PointVortex> vortices;
};

/// The Strehl ratio |∫U·exp(−iφ)|²/(∫|U|)² over the array. It is 1 if φ is the field's own phase up
/// to a constant.
struct Strehl {
  double ideal = 0.0;  ///< the vortices' phase is arg(z − z_v) at every point of the field
  /// The vortices' phase is interpolated bilinearly from the lenslets, for a mirror cannot jump.
  double mirror = 0.0;
};

/// Returns the Strehl ratio after the estimate was taken off. Between lenslets the smooth part is
/// interpolated by cubic convolution (R. G. Keys, IEEE Trans. ASSP 29, 1153, 1981). Beyond the
/// outermost centres both parts go on as odd reflections.
Strehl strehl_after(const PhaseField& field, const PhaseEstimate& estimate);

/// Returns the Strehl ratio without any correction.
double strehl_uncorrected(const PhaseField& field);

}  // namespace curlew
