// This file declares the step from pixels to centroids. One pass applies dark, flat, bad pixels and
// threshold and sums the moments and their noise.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "centroiding/centroid_method.h"
#include "centroiding/pixel_codes.h"
#include "centroiding/sensor.h"
#include "centroiding/window_strips.h"
#include "core/centroids.h"
#include "core/frame.h"
#include "core/image.h"

namespace curlew {

class Team;          // core/team.h
struct FrameLevels;  // frame_level.h
struct SharpPixels;  // sharp_pixels.h

/// These options say what counts as light and which lenslets count. The threshold T is the largest
/// of the three thresholds. A pixel's signal is what exceeds it, max(I − T, 0), so that the signal
/// does not jump where a pixel reaches T.
struct CentroidOptions {
  double threshold_adu = 0.0;       ///< T above the background, in ADU
  double threshold_relative = 0.0;  ///< T as a fraction of the window's peak above the background
  double threshold_noise = 4.0;     ///< T in standard deviations of the read noise
  double min_snr = 5.0;             ///< least flux over its noise; a lenslet below it is missing
  /// A spot as near as this to its window's edge is missing; the unit is the window's width.
  double edge_fraction = 0.1;
  double max_bad_fraction = 0.25;  ///< a window with a larger fraction of bad pixels is missing

  /// The level between the spots, and its noise, are those of every frame (frame_level.h). Where
  /// false they are those of the calibration.
  bool follow_level = true;
  /// The windows follow the spots (window_follower.h). Where false they stay where the calibration
  /// put them. Has no effect without follow_level.
  bool follow_windows = true;
  /// Frames are measured while they are read out, where the camera tells its rows. The noise of the
  /// whole frame is not known then, so every frame, whole or not, goes by that of the frame before
  /// where the two differ by less than an eighth. The results then depend on the frame before.
  bool measure_ahead = false;

  /// This says how positions are found; centroid_methods.h describes all methods but the two
  /// centres of gravity. Flux and second moments are always those above T. For kPlain, T is 0.
  CentroidMethod method = CentroidMethod::kThresholded;
  /// This is the σ of the Gaussian that kWeighted, kCorrelation and kMaximumLikelihood use. 0
  /// stands for .42 λ/w, which is the spot's own width at the diffraction limit, or for a sixth of
  /// the widest window where λ/w is not known.
  double spot_sigma_px = 0.0;
  /// kWeighted pulls the spot towards its reference as strongly as this much light there would; the
  /// unit is the read noise in electrons. Dark lenslets then report small slopes instead of their
  /// noise.
  double reference_pull = 3.0;
  /// kBrightestPixels uses so many pixels. 0 stands for a quarter of the pixels of the largest
  /// window, but for at most 64.
  int brightest_pixels = 0;
};

/// The plan holds all that the centroid kernel needs, in the frame's own counts. It is made once
/// per sensor, frame format and options; it is const and shared afterwards.
struct CentroidPlan {
  /// Throws Failure when the format's size, offset, binning or pixel format is not the sensor's,
  /// when the frame has fewer than 4 columns, when a map or a window of the sensor does not fit the
  /// frame, or when the sensor was calibrated for another method. Throws UsageError when an option
  /// is out of its range or a window is too large for the method.
  CentroidPlan(const Sensor& sensor, const FrameFormat& format,
               const CentroidOptions& options = {});

  using Spot = WindowSpot;

  /// Returns how many rows of the frame must be ready before lenslet row `row` can be measured.
  int frame_rows_needed(int row) const { return rows_needed_[static_cast<std::size_t>(row)]; }

  Image<Spot> spots;    ///< [rows, cols] of lenslets
  WindowStrips strips;  ///< of `spots`
  int frame_rows = 0;
  int frame_cols = 0;
  PixelType pixel_type = PixelType::kU16;

  // A pixel's signal is max(gain·count − offset, 0) with offset = gain·dark + T. Bad pixels have
  // gain 0. The maps are [frame_rows, frame_cols]. Both are empty where neither dark, flat nor bad
  // pixels are known; then the gain is 1 and the offset uniform.
  Image<float> gain;
  Image<float> offset;
  float uniform_offset = 0;
  // The same in fewer bytes. The maps above hold what these stand for. Each is empty where it would
  // be too coarse or is not needed.
  PixelWords words;
  PixelCodes codes;

  /// [lenslets + kWidestVector] the mean gain of a window's good pixels, by which the variance of a
  /// signal is larger than without a flat
  AlignedVector<float> mean_gain;

  float threshold = 0;  ///< T in counts, without the relative threshold
  float relative_threshold = 0;
  float core_threshold = 0;   ///< Sensor::core_threshold, or 0 where a relative threshold is given
  float saturation = 0;       ///< counts; infinite where it is not known
  float adu_per_count = 1;    ///< FrameFormat::scale_adu
  float counts_per_e = 0;     ///< 0 where the detector's gain is not known; no photon noise then
  float pixel_variance = 0;   ///< read noise and quantisation, counts²
  float min_snr_squared = 0;  ///< CentroidOptions::min_snr²

  CentroidMethod method = CentroidMethod::kThresholded;
  // The members below are used only by methods that are not centres of gravity.
  float spot_sigma_px = 0;
  float reference_pull = 0;  ///< counts
  int brightest_pixels = 0;
  AlignedVector<float> reference_x;  ///< [lenslets], relative to the window's centre
  AlignedVector<float> reference_y;

 private:
  std::vector<int> rows_needed_;
};

/// This is what is known of the frame at hand. Null stands for what the calibration says.
struct FrameConditions {
  const FrameLevels* levels = nullptr;  ///< its level and noise, which T follows
  /// The pixels of this list do not enter the sums, but what count_instead() says of them does.
  const SharpPixels* sharp = nullptr;
  const Image<CentroidPlan::Spot>* windows = nullptr;  ///< where the windows are; else plan.spots
  /// Where this is not null, only lenslets that are nonzero in it are measured, and all others keep
  /// what was measured before.
  const Image<std::uint8_t>* only = nullptr;
  /// These are the strips of `windows`, if the windows are not the plan's. Where this is null, such
  /// windows are measured one by one.
  const WindowStrips* strips = nullptr;
  /// Measures the positions of the valid spots again, with the plan's core_threshold as the
  /// relative threshold.
  bool cores = false;
  Team* team = nullptr;  ///< shares the work, where there is one
};

/// Returns where the windows are, [rows, cols] of lenslets.
inline const Image<CentroidPlan::Spot>& windows_of(const CentroidPlan& plan,
                                                   const FrameConditions& conditions) noexcept {
  return conditions.windows != nullptr ? *conditions.windows : plan.spots;
}

/// Returns the strips of these windows, or null.
inline const WindowStrips* strips_of(const CentroidPlan& plan,
                                     const FrameConditions& conditions) noexcept {
  return conditions.windows != nullptr ? conditions.strips : &plan.strips;
}

/// Measures every lenslet's spot. The list below describes the centres of gravity;
/// centroid_methods.h describes the other methods. The frame must be of the plan's format, and the
/// maps of `centroids` must be of the size of plan.spots. Here v is the signal of a pixel of the
/// window, F = Σv, and x̄ = Σvx/F:
///
/// - x_px and y_px are the centre of gravity, and xx, yy and xy the central second moments, both of
///   the signal above the threshold.
/// - The variances follow from photon, read and quantisation noise by first-order propagation
///   through the thresholded ratio, Σ Var(v)(x − x̄)²/F²; see SignalVariance.
/// - `state` says which lenslets are unlit, faint, saturated, at their window's edge or have too
///   many bad pixels. Faint spots and those at the edge keep what was measured. All others that are
///   not valid hold zeros, except for their flux.
///
/// The same pixels, plan and conditions always give the same bits.
void find_centroids(const CentroidPlan& plan, FrameView frame, Centroids& centroids,
                    const FrameConditions& conditions = {}) noexcept;

/// Measures the positions of valid spots and their variances again by the light of their cores,
/// where the plan has cores. Flux and second moments stay those of all light. The conditions must
/// be those with which the spots were measured, but for the strips.
void find_core_positions(const CentroidPlan& plan, FrameView frame, Centroids& centroids,
                         FrameConditions conditions = {}) noexcept;

/// Measures lenslet rows [first, last) only, for frames that are still arriving. It reads the
/// frame's first plan.frame_rows_needed(last − 1) rows and no more. The rows must be measured in
/// ascending order, because n_valid and n_saturated start again at row 0. A team changes no bit.
void find_centroids_rows(const CentroidPlan& plan, FrameView frame, int first, int last,
                         Centroids& centroids, const FrameConditions& conditions = {}) noexcept;

}  // namespace curlew
