// Pixels to centroids: dark, flat, bad pixels, threshold, moments and their noise, in one pass.
#pragma once

#include <cstddef>
#include <vector>

#include "centroiding/centroid_method.h"
#include "centroiding/sensor.h"
#include "core/centroids.h"
#include "core/frame.h"
#include "core/image.h"

namespace curlew {

/// What counts as light and which lenslets count. The threshold T is the largest of the three; a
/// pixel's signal is what exceeds it, max(I − T, 0), so that a pixel at T adds no step.
struct CentroidOptions {
  double threshold_adu = 0.0;       ///< T above the background, in ADU
  double threshold_relative = 0.0;  ///< T as a fraction of the window's peak above the background
  double threshold_noise = 4.0;     ///< T in standard deviations of the read noise
  double min_snr = 5.0;             ///< fainter than this (flux over its noise) is missing
  double edge_fraction = 0.1;  ///< a spot this near (in window widths) its window's edge is missing
  double max_bad_fraction = 0.25;  ///< a window with more of its pixels bad is missing

  /// How positions are found; flux and second moments are always those above T. What is said of
  /// the others: centroid_methods.h. kPlain: T is 0.
  CentroidMethod method = CentroidMethod::kThresholded;
  /// σ of the Gaussian of kWeighted, kCorrelation and kMaximumLikelihood. 0: .42 λ/w, which is the
  /// spot's own width at the diffraction limit, or a sixth of the window where λ/w is not known.
  double spot_sigma_px = 0.0;
  /// Of kWeighted: with how much light (in read noises: 3 are 3 times its electrons) the reference
  /// holds the spot. Dark lenslets then report small slopes instead of their noise.
  double reference_pull = 3.0;
  int brightest_pixels = 0;  ///< of kBrightestPixels; 0: a quarter of the window's, 64 at most
};

/// All that the centroid kernel needs, in the frame's own counts. Built once per sensor, frame
/// format and options; const and shared afterwards.
struct CentroidPlan {
  /// Throws Failure when the format's size, offset or binning is not the sensor's or the sensor's
  /// maps are of another size, UsageError when an option is out of its range.
  CentroidPlan(const Sensor& sensor, const FrameFormat& format,
               const CentroidOptions& options = {});

  /// One lenslet's window. Inside the kernel coordinates are relative to the window's centre.
  struct Spot {
    int x0 = 0;  ///< first column; the window is w by h pixels
    int y0 = 0;
    int w = 0;
    int h = 0;
    float min_x = 0;  ///< nearer the edge than this, relative to the centre, is kAtEdge
    float max_x = 0;
    float min_y = 0;
    float max_y = 0;
    std::size_t map = 0;  ///< where the window's rows begin in gain and offset
    LensletState state = LensletState::kUnlit;  ///< as far as known beforehand
  };

  /// Rows of the frame that must be ready before lenslet row `row` can be measured.
  int frame_rows_needed(int row) const { return rows_needed_[static_cast<std::size_t>(row)]; }

  Image<Spot> spots;  ///< [rows, cols] of lenslets
  int frame_rows = 0;
  int frame_cols = 0;
  PixelType pixel_type = PixelType::kU16;

  // A pixel's signal is max(gain·count − offset, 0), offset = gain·dark + T;
  // bad pixels have gain 0. Window after window, each [h, w], in the order in which the kernel
  // walks: memory is read straight on. Both empty where neither dark, flat nor bad pixels are
  // known: then gain is 1 and the offset uniform. kMapMargin values before and after may be loaded
  // and are never used.
  static constexpr std::size_t kMapMargin = 16;
  AlignedVector<float> gain;
  AlignedVector<float> offset;
  float uniform_offset = 0;

  float threshold = 0;  ///< T in counts, without the relative one
  float relative_threshold = 0;
  float saturation = 0;       ///< counts; infinite where unknown
  float adu_per_count = 1;    ///< FrameFormat::scale_adu
  float counts_per_e = 0;     ///< 0 where the detector's gain is unknown: no photon noise then
  float pixel_variance = 0;   ///< read noise and quantisation, counts²
  float min_snr_squared = 0;  ///< CentroidOptions::min_snr²

  CentroidMethod method = CentroidMethod::kThresholded;
  // Of methods other than the centres of gravity:
  float spot_sigma_px = 0;
  float reference_pull = 0;  ///< counts
  int brightest_pixels = 0;
  AlignedVector<float> reference_x;  ///< [lenslets], relative to the window's centre
  AlignedVector<float> reference_y;

 private:
  std::vector<int> rows_needed_;
};

/// Measures every lenslet's spot. What follows is said of the centres of gravity; for the other
/// methods see centroid_methods.h. The frame must be of the plan's format and `centroids` of the
/// plan's lenslets. Where x̄ = Σvx/Σv over the window's signals v:
///
/// - x_px, y_px: the centre of gravity; xx, yy, xy: central second moments, both of the signal
///   above the threshold;
/// - variances: first-order propagation of photon, read and quantisation noise through the
///   thresholded ratio, Σ Var(v)(x − x̄)²/F², see variance_of_signal() in
///   centroid.cpp;
/// - a lenslet that is unlit, faint, saturated, at its window's edge or has too many bad pixels
///   says so in `state` and holds zeros, except for its flux.
///
/// Same pixels, same plan: same bits.
void find_centroids(const CentroidPlan& plan, FrameView frame, Centroids& centroids) noexcept;

/// The same for lenslet rows [first, last), for frames that are still arriving:
/// the frame's first plan.frame_rows_needed(last − 1) rows are read and no more. Call for ascending
/// rows; n_valid and n_saturated start again at row 0.
void find_centroids_rows(const CentroidPlan& plan, FrameView frame, int first, int last,
                         Centroids& centroids) noexcept;

}  // namespace curlew
