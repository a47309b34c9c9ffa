// SpotModel models the light of one lenslet's spot on the detector's pixels, and what a window and
// a threshold make of the spot's displacement.
#pragma once

#include <vector>

#include "centroiding/sensor.h"
#include "core/image.h"
#include "core/spot_profile.h"

namespace curlew {

/// A SpotView says how a spot is seen, in the units of the frame.
struct SpotView {
  Window window;
  double x_px = 0.0;  ///< the spot's centre on the frame
  double y_px = 0.0;
  double total_adu = 0.0;  ///< all light of the spot, inside the window and outside
  double threshold_adu = 0.0;
  double threshold_relative = 0.0;  ///< over the brightest pixel; the larger threshold holds
  double noise_adu = 0.0;           ///< rms noise of a pixel without light
  double adu_per_e = 0.0;           ///< photon noise follows from it; 0 for none
};

/// Returns what a pixel's light yields above the threshold, averaged over its noise; all in ADU,
/// and noise_adu as in SpotView.
double mean_signal(double light, double threshold, double noise_adu, double adu_per_e);

/// These are sums over the window of what exceeds the threshold, averaged over frames. Noise of rms
/// σ lifts pixels near the threshold T over it, so that with u = I − T the light I yields
///     E[max(u + n, 0)] = u·Φ(u/σ) + σ·φ(u/σ).
/// Without noise, wings of the spot would come and go like steps, and the gain with them.
struct SpotMoments {
  double flux_adu = 0.0;
  double x_px = 0.0;  ///< centre of gravity on the frame
  double y_px = 0.0;
  double spread_px2 = 0.0;  ///< central second moments, x and y together
};

/// A window gain is the measured over the true displacement of the centre of gravity.
struct WindowGain {
  double x = 1.0;
  double y = 1.0;
};

/// SpotModel is a SpotProfile along either axis.
class SpotModel {
 public:
  /// Takes the lengths of SpotProfile, in px.
  SpotModel(double diffraction_px, double blur_px) : profile_(diffraction_px, blur_px) {}

  double share(double x_px) const { return profile_.share(x_px); }  ///< of SpotProfile

  /// Returns the light in the window's pixels [h, w] in ADU, without noise.
  Image<float> picture(const SpotView& view) const;

  /// Returns what the centroid kernel reads of such a spot. It is zeros where nothing exceeds the
  /// threshold.
  SpotMoments moments(const SpotView& view) const;

  /// Returns the light that a spot must have for `flux_adu` above the threshold in a frame without
  /// noise (view.total_adu, noise_adu and adu_per_e are not read).
  double total_for_flux(const SpotView& view, double flux_adu) const;

  /// Returns the gain from shifts of ±0.05 px. It is 1 where nothing exceeds the threshold.
  WindowGain window_gain(const SpotView& view) const;

 private:
  std::vector<double> shares(double centre, int first, int n) const;

  SpotProfile profile_;
};

}  // namespace curlew
