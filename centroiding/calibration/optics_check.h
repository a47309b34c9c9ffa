// This file declares what calibration holds the user's optics against: the pitch and the spots of
// the reference.
#pragma once

#include <string>
#include <vector>

#include "core/optics.h"

namespace curlew {

/// Returns w·m/p, the pitch in px that the optics promise. It is NaN where they are not known.
double expected_pitch_px(const Optics& optics);

/// Returns λ·f·m/(w·p), the spot's width d in px that diffraction alone gives. Where the pitch
/// found contradicts the optics, m/p is that of the pitch found. It is NaN where the optics are not
/// known.
double diffraction_px(const Optics& optics, double found_pitch_px);

/// Compares the pitch found with that of the optics. Returns a sentence where it is off by more
/// than 3 %, and throws Failure beyond 20 %. Only a pitch of about half as many px is accepted with
/// a sentence, because 2×2 binning and relays of 1:2 that nobody mentioned look like this.
std::vector<std::string> check_pitch(const Optics& optics, double found_pitch_px);

/// Compares the spots with diffraction. `width_over_diffraction` is NaN where it is not known.
/// Throws Failure for spots narrower than half of what diffraction allows, and returns a sentence
/// below .8 and above 4 of it. Spots of d below 1.5 px are not refused, since their pixels are as
/// wide.
std::vector<std::string> check_spot_width(const Optics& optics, double found_pitch_px,
                                          double width_over_diffraction);

}  // namespace curlew
