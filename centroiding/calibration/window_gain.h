// This file declares the window gain: the part of a spot's displacement that a finite window and a
// threshold let through.
#pragma once

#include <cstdint>
#include <vector>

#include "centroiding/calibration/spot_model.h"
#include "centroiding/centroid.h"
#include "centroiding/sensor.h"
#include "core/image.h"

namespace curlew {

/// Light counts as signal where it exceeds the larger of the two thresholds.
struct SignalThreshold {
  double min_adu = 0.0;
  double relative = 0.0;  ///< as a fraction of the window's brightest pixel
};

/// These are the moments of one window's signal, and its gain as far as the window's pixels tell
/// it.
struct WindowMeasurement {
  double flux_adu = 0.0;  ///< 0 where nothing exceeds the threshold; then all else means nothing
  double x_px = 0.0;      ///< centre of gravity on the frame
  double y_px = 0.0;
  double spread_px2 = 0.0;   ///< central second moments, x and y together
  WindowGain gain;           ///< described at measure_window()
  bool gain_is_sure = true;  ///< The gain's standard deviation is at most 0.1.
};

/// Measures one window. `light` is [rows, cols] of the frame in ADU, less the background, with
/// noise_adu rms. `bad` is 1 where a pixel does not count, or empty.
///
/// The gain along x follows from the signals f of the window's first and last columns, x₀ and x₁:
///     1 − Σ_rows [(x̄ − x₀ + ½)·f(x₀) + (x₁ + ½ − x̄)·f(x₁)] / Σf,
/// which subtracts the light on the edges times its lever arm. It is the discrete form of 1 −
/// 2W·S(W)/∫S for a window ±W, and holds where the edge pixels' mean light is the light at the
/// window's very edge.
WindowMeasurement measure_window(const Image<float>& light, const Image<std::uint8_t>& bad,
                                 const Window& window, const SignalThreshold& threshold,
                                 double noise_adu);

/// This is the noise of a frame, and of the mean of the reference frames.
struct PictureNoise {
  double frame_adu = 0.0;  ///< rms of a pixel without light
  double adu_per_e = 0.0;  ///< photon noise follows from it
  int frames = 1;          ///< whose mean the picture is
};

/// This is how a displacement is told from the measured one along an axis: Sensor's gain, bend2 and
/// bend3.
struct GainCurve {
  double gain = 1.0;
  double bend2 = 0.0;
  double bend3 = 0.0;
  double line_gain = 1.0;  ///< the mean gain within half a pixel; that of a line instead

  bool is_bent() const { return bend2 != 0.0 || bend3 != 0.0; }
};

/// These are a window's curves along both axes.
struct WindowCurves {
  GainCurve x;
  GainCurve y;
};

/// A SpotRange says which true displacements from the reference, px, the curve of an axis is for.
struct SpotRange {
  double low_px = 0.0;
  double high_px = 0.0;
  double straight_px = 0.01;  ///< A line is taken where the best is nowhere wrong by more.
};

/// Returns the curves of the centre of gravity that the picture itself shows when it is moved
/// under the window, neighbours' light and all. A line's gain is the mean within half a pixel.
/// Between pixels the picture is interpolated after
/// Lagrange (six points), which takes spots of σ ≥ 0.9 px. `light` is as for measure_window(). A
/// gain is NaN where nothing exceeds the threshold.
WindowCurves curves_of_picture(const Image<float>& light, const Window& window,
                               const SignalThreshold& threshold, const PictureNoise& noise,
                               const SpotRange& along_x, const SpotRange& along_y);

/// Returns the displacements from the reference to which a curve is fitted that is to reach as far
/// as curve_reach_px(), where the reference is off_px from its window's middle.
SpotRange range_of_spots(double off_px, double reach_px);

/// This says how the reference picture came about.
struct ReferenceFrames {
  int frames = 1;              ///< whose mean it is
  double adu_per_count = 1.0;  ///< their values are rounded to it
  bool light_is_cut = false;   ///< CalibrationInput::light_is_cut
};

struct WindowGains {
  std::vector<WindowCurves> curves;  ///< [rows·cols], straight where a lenslet is not valid
  double width_over_diffraction = kUnknown;  ///< of the typical spot; NaN for unknown optics
  double spot_blur_px = 0.0;  ///< σ of the blur that widens the typical spot beyond diffraction
};

/// Returns the curves of all valid lenslets. Where spots are well sampled and no light is cut,
/// curves_of_picture() tells them for the centres of gravity; where the spots' cores are narrow it
/// tells lines. They are lines, too, unless half of them are bent, as dense spots' are: beside
/// lines, a few curves and windows of their own would only add to the noise. Where spots are not
/// well sampled, curves are straight. Their gains are the measured ones, corrected by their error
/// on the modelled spot. At 2 pixels per λ/w the edge pixel reaches from one fringe of the spot
/// into the next, and the measured gain is wrong by up to 15 %. On the model, which has the
/// lenslet's window, position and flux, both the measured and the true gain can be computed, and
/// their ratio is the correction. A gain that is not sure is replaced by the model's alone. The
/// model's spot is whole, so its curve is not that of spots that turbulence widens: with it, slopes
/// were 2 % too large there.
///
/// For methods other than the centres of gravity nothing is measured. Their gain is the one that
/// the kernel itself shows on the modelled spot, moved by ±0.25 px. The gain of the brightest
/// pixels is not linear (it varies by 15 % with 6 px of 2 per λ/w).
///
/// The model's blur gives it the spread of the typical spot, which is the one of median spread.
/// Flux, and the noise at the threshold, are those of one frame of the reference. `light` is as for
/// measure_window().
WindowGains find_window_gains(const Sensor& sensor, const Image<float>& light,
                              const std::vector<WindowMeasurement>& measured,
                              const SignalThreshold& threshold, const CentroidOptions& options,
                              const ReferenceFrames& reference);

}  // namespace curlew
