// This file declares the choice among candidates: the set of vortices that the slopes as a whole
// support is believed.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/fixed_list.h"
#include "core/slope_field.h"
#include "core/vortex.h"
#include "reconstruct/vortex_choice_plan.h"

namespace curlew {

/// These are the buffers of one frame, made once.
struct VortexChoiceWorkspace {
  explicit VortexChoiceWorkspace(const VortexChoicePlan& plan);

  FixedList<Vortex> candidates;
  AlignedVector<std::int32_t> tile;    ///< [candidates] tile to which each belongs
  std::vector<std::uint8_t> believed;  ///< [candidates] the result: 1 where believed

  // The members below describe the tile in hand. The measured loops are vector 0, and those of
  // local candidate i are vector i + 1.
  FixedList<std::size_t> local;  ///< candidates in the tile or near it
  AlignedVector<float> loops;    ///< [vectors / kLanes, faces, kLanes] L⁻¹l of all vectors
  Image<float> overlap;          ///< [vectors, vectors] lᵀ(RᵀR)⁻¹l, below the diagonal
  AlignedVector<float> gain;  ///< [candidates] lᵀ(RᵀR)⁻¹ times the loops not yet explained
  AlignedVector<float> cost;  ///< −log-odds times prior_weight
  std::vector<std::uint8_t> chosen;
};

/// Chooses among the candidates the set V for which
///     ½ Σ|s_sol − s_sol(V)|²/slope_variance − prior_weight·Σ_V ln(p/(1−p))
/// is least, where s_sol is the solenoidal part of the slopes and s_sol(V) that of the vortices. A
/// vortex shows in every slope of the pupil, as 1/r, so that a vortex without its opposite costs
/// much. A detector, which looks at a few lenslets, cannot know this. The search starts from all
/// candidates with p ≥ ½ and goes downhill. Each step adds or takes away one or two candidates.
///
/// Unresolved pairs (charge 0) and candidates more than 2 pitches off the array are left out.
/// Candidates beyond the capacity are not judged, so that the surest should come first. A lenslet
/// that is not valid in the frame takes the mean slope of its neighbours here. `chosen` is cleared
/// first; candidates that do not fit are counted in its overflow.
void choose_vortices(const VortexChoicePlan& plan, const VortexList& candidates,
                     const SlopeField& slopes, VortexChoiceWorkspace& workspace,
                     VortexList& chosen) noexcept;

}  // namespace curlew
