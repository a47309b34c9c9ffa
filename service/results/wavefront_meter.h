// A WavefrontMeter says in a few numbers how good a wavefront is.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/image.h"
#include "core/slope_field.h"
#include "reconstruct/modes/mode_fit.h"
#include "reconstruct/split.h"

namespace curlew {

/// The last of Noll's modes in results; with it there are seven radial orders.
inline constexpr int kLastNoll = 36;

/// Returns the modes for the plan's lit lenslets: seven radial orders, or as many as they allow.
ModePlan modes_of(const SplitPlan& split);

/// Of the wavefront at the centres of the valid lenslets, less its mean and its tilt, which are
/// those of the plane that fits best.
struct WavefrontFigures {
  double rms_rad = 0.0;
  double peak_to_valley_rad = 0.0;

  /// The Strehl ratio by Maréchal's exponential, exp(−rms²): good where rms is below 1 rad.
  double strehl() const;
};

/// Returns the length in nm that a phase has at a wavelength; NaN where that is not known.
double nm_of(double rad, double wavelength_m);

/// The split's phase at a lenslet is the mean of its four corners', and corners are tied by means
/// over lenslets, so the phase is weaker than the wave: one of k rad a pitch has 1 − (5/48)·k² of
/// its height in it, on the average over the wave's directions and to the order k³. The meter
/// therefore takes what the split makes of the fitted modes out of the phase, (5/48) of the
/// Laplacian off what remains, and puts the modes themselves back. Figures of waves within the
/// modes are right within 1 %.
class WavefrontMeter {
 public:
  explicit WavefrontMeter(const SplitPlan& split);
  WavefrontMeter(const WavefrontMeter&) = delete;
  WavefrontMeter& operator=(const WavefrontMeter&) = delete;

  /// Fits the modes to a frame's slopes and measures its phase, [rows, cols], as the split of these
  /// slopes gives it. Returns NaN for all where fewer than three lenslets are valid, or all lie in
  /// one line. Where the lenslets do not tell the modes apart, the Laplacian of all is taken off.
  WavefrontFigures measure(const Image<float>& phase_rad, const SlopeField& slopes) noexcept;

  const ModePlan& modes() const { return modes_; }
  /// The fit to the slopes that were measured last.
  ModeFit& fit() { return fit_; }

 private:
  void split_modes(const SplitPlan& split);

  ModePlan modes_;
  ModeFit fit_;
  std::vector<std::size_t> lenslets_;  ///< the lit ones
  // [lit lenslets, modes] rad for 1 rad of the mode: what the split makes of it, and its own height
  Eigen::MatrixXd phase_of_modes_;
  Eigen::MatrixXd height_of_modes_;
  Eigen::VectorXd height_;  ///< [lit lenslets] rad
  Image<float> remaining_;  ///< rad
};

}  // namespace curlew
