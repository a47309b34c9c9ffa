// SpotModel: the light of one lenslet's spot on the detector's pixels, and what a window and a
// threshold make of its displacement.
#pragma once

#include <vector>

#include "centroiding/sensor.h"
#include "core/image.h"

namespace curlew {

/// How a spot is looked at, in the units of the frame.
struct SpotView {
  Window window;
  double x_px = 0.0;  ///< the spot's centre on the frame
  double y_px = 0.0;
  double total_adu = 0.0;  ///< its light, within the window and without
  double threshold_adu = 0.0;
  double threshold_relative = 0.0;  ///< of the brightest pixel; the larger threshold holds
  double noise_adu = 0.0;           ///< of a pixel without light; rms
  double adu_per_e = 0.0;           ///< with it comes photon noise
};

/// Sums over the window of what exceeds the threshold, on average over frames: noise σ lifts pixels
/// at the threshold T over it, so that for light I they yield, with u = I − T,
///   E[max(u + n, 0)] = u·Φ(u/σ) + σ·φ(u/σ).
/// Without it wings of the spot come and go like steps, and the gain with them.
struct SpotMoments {
  double flux_adu = 0.0;
  double x_px = 0.0;  ///< centre of gravity on the frame
  double y_px = 0.0;
  double spread_px2 = 0.0;  ///< central second moments, x and y together
};

/// Window gain: measured over true displacement of the centre of gravity.
struct WindowGain {
  double x = 1.0;
  double y = 1.0;
};

/// The spot of a square, evenly lit lenslet, sinc²(x/d)·sinc²(y/d) with d = λ·f·m/w (J. W. Goodman,
/// Introduction to Fourier Optics, 2005, sec. 4.4.1), blurred by a Gaussian and integrated over
/// square pixels. Along each axis that is, over the frequencies f that the lenslet passes,
///   P(x) = 2 ∫₀^{1/d} (1 − f·d)·sinc(f)·exp(−2π²σ²f²)·cos(2πfx) df,
/// the light in a pixel whose centre lies x from the spot's.
class SpotModel {
 public:
  /// Both in px. diffraction_px: d; where it is not positive the spot is the Gaussian alone, whose
  /// blur is then at least 0.2 px.
  SpotModel(double diffraction_px, double blur_px);

  /// The share of the light in a column (or row) of pixels whose centre is x_px from the spot's.
  double share(double x_px) const;

  /// The window's pixels [h, w] in ADU, without noise.
  Image<float> picture(const SpotView& view) const;

  /// What the centroid kernel reads of such a spot; zeros where nothing exceeds the threshold.
  SpotMoments moments(const SpotView& view) const;

  /// The light that a spot must have for `flux_adu` above the threshold in a frame without noise
  /// (view.total_adu, noise_adu and adu_per_e are not read).
  double total_for_flux(const SpotView& view, double flux_adu) const;

  /// From shifts of ±0.05 px; 1 where nothing exceeds the threshold.
  WindowGain window_gain(const SpotView& view) const;

 private:
  std::vector<double> shares(double centre, int first, int n) const;

  double step_ = 0.0;           // between frequencies, cycles per px
  std::vector<double> weight_;  // of every frequency, with the quadrature's
};

}  // namespace curlew
