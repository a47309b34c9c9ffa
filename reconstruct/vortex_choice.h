// Which candidates to believe: the set of vortices that the slopes as a whole speak for.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/fixed_list.h"
#include "core/slope_field.h"
#include "core/vortex.h"
#include "reconstruct/vortex_choice_plan.h"

namespace curlew {

/// Buffers of one frame, made once.
struct VortexChoiceWorkspace {
  explicit VortexChoiceWorkspace(const VortexChoicePlan& plan);

  FixedList<Vortex> candidates;
  AlignedVector<std::int32_t> tile;    ///< [candidates] each belongs to
  std::vector<std::uint8_t> believed;  ///< [candidates] the result

  // Of the tile in hand:
  FixedList<std::size_t> local;   ///< candidates in it
  AlignedVector<float> measured;  ///< [faces] L⁻¹ of the measured loops
  AlignedVector<float> scratch;   ///< [faces] 0 between uses
  std::vector<std::uint8_t> marked;
  AlignedVector<std::int32_t> element;  ///< L⁻¹ of each candidate's loops: where …
  AlignedVector<float> value;           ///< … and how much
  std::vector<std::size_t> start;       ///< [candidates + 1]
  Image<float> overlap;                 ///< [candidates, candidates] lᵀ(RᵀR)⁻¹l
  AlignedVector<float> gain;            ///< of each candidate, l against what is still unexplained
  AlignedVector<float> cost;            ///< −log-odds times prior_weight
  std::vector<std::uint8_t> chosen;
};

/// Chooses among candidates the set V that makes least
///   ½ Σ|s_sol − s_sol(V)|²/slope_variance − prior_weight·Σ_V ln(p/(1−p)),
/// s_sol the solenoidal part of the slopes, s_sol(V) that of the vortices. A vortex shows in every
/// slope of the pupil, as 1/r, so that one without its opposite costs much: what a detector, which
/// looks at a few lenslets, cannot know. From all with p ≥ ½ it goes downhill, changing its mind on
/// one or two candidates at a time. Unresolved pairs (charge 0), and what
/// lies over 2 pitches off the array, are left out. Candidates beyond the
/// capacity are not judged: give the surest first.
/// Lenslets that are not valid in the frame have the mean slope of their neighbours here.
/// chosen is cleared first; of the candidates that do not fit the overflow is counted.
void choose_vortices(const VortexChoicePlan& plan, const VortexList& candidates,
                     const SlopeField& slopes, VortexChoiceWorkspace& workspace,
                     VortexList& chosen) noexcept;

}  // namespace curlew
