// Hidden phase: what a least-squares phase leaves out, made good from the vortices.
//
// The slopes of a field with vortices are those of a smooth phase and of Σ charge·arg(z − z_v).
// Least squares sees only what of the second looks like a gradient (an image of the vortices beyond
// the pupil's edge) and takes it for phase. So
//   whole = LS(s − s_vortices) + φ_vortices = LS(s) + [φ_vortices − LS(s_vortices)],
// the bracket being the hidden phase (D. L. Fried, J. Opt. Soc. Am. A 15, 2759, 1998): nothing is
// counted twice, whatever the pupil, and LS is the same linear solver for both.
#pragma once

#include <cstddef>

#include "core/hodge_split.h"
#include "core/image.h"
#include "core/slope_field.h"
#include "core/vortex.h"
#include "reconstruct/branch_cuts.h"
#include "reconstruct/split.h"
#include "reconstruct/vortex_choice.h"
#include "reconstruct/vortex_field.h"

namespace curlew {

struct HiddenPhaseOptions {
  /// Judge the candidates by the slopes as a whole (vortex_choice.h). False: all that are probable,
  /// p ≥ ½ or unknown, are believed.
  bool choose = true;
  VortexChoiceOptions choice;
  /// Softening of the vortices' slopes given to least squares, pitches².
  float softening = 0.2F;
};

/// All that follows from the split's pupil. Const after construction, shared by threads.
class HiddenPhasePlan {
 public:
  /// split: of the pupil, must outlive the plan. max_vortices: the most candidates of a frame.
  /// Throws UsageError on options out of range.
  HiddenPhasePlan(const SplitPlan& split, const HiddenPhaseOptions& options,
                  std::size_t max_vortices);

  const HiddenPhaseOptions& options() const { return options_; }
  const SplitPlan& split() const { return *split_; }
  const VortexChoicePlan& choice() const { return choice_; }

 private:
  HiddenPhaseOptions options_;
  const SplitPlan* split_;
  VortexChoicePlan choice_;
};

/// Buffers of one frame, made once, and what else is known of it afterwards.
struct HiddenPhaseWorkspace {
  explicit HiddenPhaseWorkspace(const HiddenPhasePlan& plan);

  VortexList vortices;  ///< those believed
  Image<float> smooth;  ///< [rows, cols] LS(s − s_vortices), rad at lenslet centres
  Image<float>
      rotational;  ///< [rows, cols] φ_vortices with its cuts, rad, also where no lenslet is
  BranchCutWorkspace cuts;  ///< where these run

  VortexChoiceWorkspace choice;
  FixedList<PointVortex> points;
  Image<float> wrapped;
  SlopeField vortex_slopes;
  SplitWorkspace split_workspace;
  HodgeSplit vortex_split;
};

/// whole_phase_rad: [rows, cols] at lenslet centres, rad: `split`'s least-squares phase and the
/// hidden phase of those vortices among `candidates` that the slopes speak for. It is smooth but
/// across branch cuts, where it jumps by 2π (branch_cuts.h); mean zero over the pupil's lenslets,
/// and without vortices bit for bit the least-squares phase. NaN where slopes.valid is 0.
///
/// candidates: detected vortices with their probability, the surest first; ones as improbable as
/// options.choice.min_probability help, for what is missing harms more than what is doubtful.
/// Unresolved pairs (charge 0) count for nothing. slopes: what was split. flux_adu: [rows, cols].
void add_hidden_phase(const HiddenPhasePlan& plan, const VortexList& candidates,
                      const SlopeField& slopes, const Image<float>& flux_adu,
                      const HodgeSplit& split, HiddenPhaseWorkspace& workspace,
                      Image<float>& whole_phase_rad) noexcept;

}  // namespace curlew
