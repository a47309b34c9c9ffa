#include "reconstruct/hidden_phase.h"

#include <cmath>
#include <limits>

#include "core/error.h"
#include "core/size_check.h"

namespace curlew {
namespace {

const HiddenPhaseOptions& checked(const HiddenPhaseOptions& options) {
  const VortexChoiceOptions& choice = options.choice;
  if (!(options.softening > 0.0F && choice.softening > 0.0F && choice.slope_variance > 0.0F))
    throw UsageError("softening and slope variance of the hidden phase must be more than 0");
  if (!(choice.min_probability > 0.0F && choice.min_probability <= 0.5F))
    throw UsageError("the least probability of the hidden phase must be above 0 and at most 0.5");
  if (!(choice.unknown_probability > 0.0F && choice.unknown_probability < 1.0F))
    throw UsageError("the unknown probability of the hidden phase must be between 0 and 1");
  if (!(choice.prior_weight >= 0.0F))
    throw UsageError("the prior weight of the hidden phase must be 0 or more");
  return options;
}

void believe_probable(const VortexList& candidates, VortexList& vortices) {
  vortices.clear();
  for (const Vortex& vortex : candidates) {
    const bool probable = vortex.probability < 0.0F || vortex.probability >= 0.5F;
    const bool placed = std::isfinite(vortex.x) && std::isfinite(vortex.y);
    if (vortex.charge != 0 && probable && placed) vortices.push(vortex);
  }
}

Image<std::uint8_t> lenslets_of(const SplitPlan& split) {
  Image<std::uint8_t> valid(split.lattice().rows(), split.lattice().cols());
  for (const std::int32_t k : split.lenslets()) valid[static_cast<std::size_t>(k)] = 1;
  return valid;
}

}  // namespace

HiddenPhasePlan::HiddenPhasePlan(const SplitPlan& split, const HiddenPhaseOptions& options,
                                 std::size_t max_vortices)
    : options_(checked(options)),
      split_(&split),
      choice_(lenslets_of(split), options.choice, max_vortices) {}

HiddenPhaseWorkspace::HiddenPhaseWorkspace(const HiddenPhasePlan& plan)
    : vortices(plan.choice().capacity()),
      smooth(plan.split().lattice().rows(), plan.split().lattice().cols()),
      rotational(smooth.rows(), smooth.cols()),
      cuts(smooth.rows(), smooth.cols(), plan.choice().capacity()),
      choice(plan.choice()),
      points(plan.choice().capacity()),
      wrapped(smooth.rows(), smooth.cols()),
      vortex_slopes(smooth.rows(), smooth.cols()),
      vortex_split(smooth.rows(), smooth.cols()) {}

void add_hidden_phase(const HiddenPhasePlan& plan, const VortexList& candidates,
                      const SlopeField& slopes, const Image<float>& flux_adu,
                      const HodgeSplit& split, SplitWorkspace& split_workspace,
                      HiddenPhaseWorkspace& workspace, Image<float>& whole_phase_rad) noexcept {
  const MapSize size = size_of(plan.split().lattice());
  check_size("add_hidden_phase", "slopes", size_of(slopes), size);
  check_size("add_hidden_phase", "flux", size_of(flux_adu), size);
  check_size("add_hidden_phase", "a phase", size_of(whole_phase_rad), size);
  HiddenPhaseWorkspace& ws = workspace;
  if (plan.options().choose)
    choose_vortices(plan.choice(), candidates, slopes, ws.choice, ws.vortices);
  else
    believe_probable(candidates, ws.vortices);

  const bool any = !ws.vortices.empty();
  ws.points.clear();
  for (const Vortex& vortex : ws.vortices)
    ws.points.push({vortex.x, vortex.y, static_cast<float>(vortex.charge)});
  float mean = 0.0F;
  if (any) {
    SlopeField& field = ws.vortex_slopes;
    evaluate_vortices(ws.points.begin(), ws.points.size(), plan.options().softening, ws.wrapped,
                      field.x, field.y);
    unwrap_with_cuts(ws.wrapped, flux_adu, slopes.valid, ws.cuts, ws.rotational);
    // These maps have one size, so that nothing is allocated.
    field.variance_x = slopes.variance_x;
    field.variance_y = slopes.variance_y;
    field.valid = slopes.valid;
    field.n_valid = slopes.n_valid;
    split_again(plan.split(), field, split_workspace, ws.vortex_split);
    double sum = 0.0;
    for (std::size_t k = 0; k < ws.rotational.size(); ++k)
      if (slopes.valid[k] != 0) sum += static_cast<double>(ws.rotational[k]);
    if (slopes.n_valid > 0) mean = static_cast<float>(sum / slopes.n_valid);
  } else {
    ws.rotational.fill(0.0F);
    ws.cuts.residues.clear();
    ws.cuts.cuts.clear();
    ws.cuts.light_cut = 0.0;
  }
  for (std::size_t k = 0; k < whole_phase_rad.size(); ++k) {
    if (slopes.valid[k] == 0) {
      ws.smooth[k] = whole_phase_rad[k] = std::numeric_limits<float>::quiet_NaN();
      continue;
    }
    ws.smooth[k] = any ? split.phase[k] - ws.vortex_split.phase[k] : split.phase[k];
    whole_phase_rad[k] = any ? ws.smooth[k] + (ws.rotational[k] - mean) : ws.smooth[k];
  }
}

}  // namespace curlew
