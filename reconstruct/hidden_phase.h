// The hidden phase is what a least-squares phase leaves out. It follows from the vortices.
//
// The slopes of a field with vortices are those of a smooth phase and of Σ charge·arg(z − z_v). Of
// the second, least squares sees only what looks like a gradient (an image of the vortices beyond
// the pupil's edge), and takes it for phase. So
//     whole = LS(s − s_vortices) + φ_vortices = LS(s) + [φ_vortices − LS(s_vortices)].
// The bracket is the hidden phase (D. L. Fried, J. Opt. Soc. Am. A 15, 2759, 1998). Nothing is
// counted twice, whatever the pupil, because LS is the same linear solver for both.
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
  /// If true, the candidates are judged by the slopes as a whole (vortex_choice.h). If false, all
  /// that are probable (p ≥ ½ or unknown) are believed.
  bool choose = true;
  VortexChoiceOptions choice;
  /// This softens the slopes of the vortices that least squares gets, in pitches².
  float softening = 0.2F;
};

/// The plan holds all that follows from the split's pupil. It is const after construction and
/// shared by threads.
class HiddenPhasePlan {
 public:
  /// `split` is the plan of the pupil's split and must outlive this plan. A frame has at most
  /// `max_vortices` candidates. Throws UsageError where an option is out of its range.
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

/// These are the buffers of one frame, made once, and further results about it.
struct HiddenPhaseWorkspace {
  explicit HiddenPhaseWorkspace(const HiddenPhasePlan& plan);

  VortexList vortices;      ///< the vortices that are believed
  Image<float> smooth;      ///< [rows, cols] LS(s − s_vortices), rad at lenslet centres
  Image<float> rotational;  ///< [rows, cols] φ_vortices with its cuts, rad; also without lenslets
  BranchCutWorkspace cuts;  ///< where the cuts of `rotational` run

  VortexChoiceWorkspace choice;
  FixedList<PointVortex> points;
  Image<float> wrapped;
  SlopeField vortex_slopes;
  HodgeSplit vortex_split;
};

/// Computes the whole phase: the least-squares phase of `split` plus the hidden phase of those
/// `candidates` that the slopes support. whole_phase_rad is [rows, cols] at lenslet centres, in
/// rad. It is smooth except across branch cuts, where it jumps by 2π (branch_cuts.h). Its mean over
/// the valid lenslets is 0, and without vortices it is bit for bit the least-squares phase. It is
/// NaN where slopes.valid is 0.
///
/// `candidates` are detected vortices with their probability, the surest first. Candidates as
/// improbable as options.choice.min_probability help, because a missing vortex harms more than a
/// doubtful candidate. Unresolved pairs (charge 0) are not used. `slopes` are those that were
/// split, `split_workspace` is the one that split them last, and flux_adu is [rows, cols].
void add_hidden_phase(const HiddenPhasePlan& plan, const VortexList& candidates,
                      const SlopeField& slopes, const Image<float>& flux_adu,
                      const HodgeSplit& split, SplitWorkspace& split_workspace,
                      HiddenPhaseWorkspace& workspace, Image<float>& whole_phase_rad) noexcept;

}  // namespace curlew
