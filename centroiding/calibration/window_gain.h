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

/// Returns the gain of the centre of gravity that the picture itself shows when it is moved by
/// ±0.39 px under the window, neighbours' light and all. Between pixels it is interpolated after
/// Lagrange (six points), which takes spots of σ ≥ 0.9 px. `light` is as for measure_window().
WindowGain gain_of_picture(const Image<float>& light, const Window& window,
                           const SignalThreshold& threshold, const PictureNoise& noise);

/// This says how the reference picture came about.
struct ReferenceFrames {
  int frames = 1;              ///< whose mean it is
  double adu_per_count = 1.0;  ///< their values are rounded to it
  bool light_is_cut = false;   ///< CalibrationInput::light_is_cut
};

struct WindowGains {
  std::vector<WindowGain> gains;             ///< [rows·cols], 1 where a lenslet is not valid
  double width_over_diffraction = kUnknown;  ///< of the typical spot; NaN for unknown optics
  double spot_blur_px = 0.0;  ///< σ of the blur that widens the typical spot beyond diffraction
};

/// Returns the gains of all valid lenslets. Where spots are well sampled and no light is cut,
/// gain_of_picture() tells
/// the gain of the centres of gravity. Where they are not, the gains are the measured ones,
/// corrected by their error on the modelled spot. At 2 pixels per λ/w the edge pixel reaches from
/// one fringe of the spot into the next, and the measured gain is wrong by up to 15 %. On the
/// model, which has the lenslet's window, position and flux, both the measured and the true gain
/// can be computed, and their ratio is the correction. A gain that is not sure is replaced by the
/// model's alone.
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
