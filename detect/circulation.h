// Circulation of every cell of four lenslets, and its variance.
#pragma once

#include "core/slope_field.h"
#include "core/vortex.h"

namespace curlew {

/// Fills `map` ([rows−1, cols−1], rad and rad²) from `slopes` ([rows, cols], rad per pitch):
///   D = ½[s_x(r,c) + s_x(r,c+1) + s_y(r,c+1) + s_y(r+1,c+1)
///         − s_x(r+1,c+1) − s_x(r+1,c) − s_y(r+1,c) − s_y(r,c)],
/// Chen, Roux & Olivier, JOSA A 24, 1994 (2007), Eq. (circ) with its misprint mended (DESIGN.md).
/// Positive where the phase grows along (r,c) → (r,c+1) → (r+1,c+1) → (r+1,c).
/// A cell with an invalid lenslet is invalid, with value and variance 0. The variance takes the
/// lenslets as independent of one another, x and y of one lenslet as correlated by their
/// covariance.
void circulate(const SlopeField& slopes, CirculationMap& map) noexcept;

/// The same for cell rows [first, last) only, which need lenslet rows [first, last]. Returns how
/// many of these cells are valid and leaves map.n_valid alone: the caller adds the parts up.
int circulate_rows(const SlopeField& slopes, int first, int last, CirculationMap& map) noexcept;

/// Significance where σ_D is 0 or next to nothing: large, and finite.
inline constexpr float kMaxSignificance = 1e6F;

/// |D| over its standard deviation, at most kMaxSignificance.
float significance(float circulation_rad, float variance_rad2) noexcept;

}  // namespace curlew
