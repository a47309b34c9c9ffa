// This file declares the circulation of every cell of four lenslets, and its variance.
#pragma once

#include "core/slope_field.h"
#include "core/vortex.h"

namespace curlew {

/// Fills `map` ([rows−1, cols−1], rad and rad²) from `slopes` ([rows, cols], rad per pitch):
///     D = ½[s_x(r,c) + s_x(r,c+1) + s_y(r,c+1) + s_y(r+1,c+1)
///           − s_x(r+1,c+1) − s_x(r+1,c) − s_y(r+1,c) − s_y(r,c)].
/// This is Eq. 11 of Chen, Roux & Olivier, JOSA A 24, 1994 (2007), with its misprint mended
/// (docs/paper.md, error 1). D is positive where the phase grows along (r,c) → (r,c+1) → (r+1,c+1)
/// → (r+1,c). A cell with an invalid lenslet is invalid, and its value and variance are 0. The
/// variance takes different lenslets as independent of one another, and x and y of one lenslet as
/// correlated by their covariance.
void circulate(const SlopeField& slopes, CirculationMap& map) noexcept;

/// Fills cell rows [first, last) only, which need lenslet rows [first, last]. Returns how
/// many of these cells are valid and does not change map.n_valid: the caller adds up the parts.
int circulate_rows(const SlopeField& slopes, int first, int last, CirculationMap& map) noexcept;

/// This is the significance where σ_D is 0 or almost 0. It is large and finite.
inline constexpr float kMaxSignificance = 1e6F;

/// Returns |D| over its standard deviation, but at most kMaxSignificance.
float significance(float circulation_rad, float variance_rad2) noexcept;

}  // namespace curlew
