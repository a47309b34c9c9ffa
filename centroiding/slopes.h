// This file declares the step from centroids to slopes: displacements from the reference are
// resolved along the lenslet axes and turned into radians.
#pragma once

#include "centroiding/sampling_curve.h"
#include "centroiding/sensor.h"
#include "core/centroids.h"
#include "core/image.h"
#include "core/slope_field.h"

namespace curlew {

/// The plan holds what turns each lenslet's displacement into a slope.
struct SlopePlan {
  /// Throws Failure when optics or grid cannot give a slope: a length is unknown or not positive,
  /// the grid has no area, or a valid lenslet has no reference or gain.
  explicit SlopePlan(const Sensor& sensor);

  /// Takes the centres of gravity of undersampled spots, references included, to where they lie.
  SamplingCurve sampling;
  Image<float> ref_x_px;  ///< [rows, cols] of lenslets; 0 where not valid
  Image<float> ref_y_px;
  Image<float> inverse_gain_x;
  Image<float> inverse_gain_y;
  bool is_bent = false;  ///< Whether the sensor has bends; without, the next seven are not used.
  /// These are Sensor::bend2_x to bend3_y. They are for measured displacements, within the window,
  /// that are within reach_px of −off.
  Image<float> bend2_x;
  Image<float> bend2_y;
  Image<float> bend3_x;
  Image<float> bend3_y;
  Image<float> off_x_px;  ///< off_middle_px() of the reference
  Image<float> off_y_px;
  float reach_px = 0;
  /// This is the relative error of the gain: half of the fraction by which the gain, on average
  /// over the reach, lies below the median lenslet's, because what a window cuts off is not the
  /// same in every frame. A displacement d adds (error·d)² to the variance.
  Image<float> gain_error_x;
  Image<float> gain_error_y;
  /// This is the variance of a spot's core. It stands in for that of weak spots whose own variance
  /// is 0.
  float spot_variance_px2 = 0;
  /// Optics and aliasing leave a spot off any smooth field, by .03 of the reference spot's σ.
  /// add_systematic_error() adds this to the noise. It is 0, and the variance below infinite, where
  /// the reference spot is not known.
  float systematic_variance_px2 = 0;
  float reference_variance_px2 = 0;  ///< σ² of the reference spots above the threshold
  /// This is the variance of a spot that may be anywhere in its window, in rad² per pitch².
  Image<float> window_variance;

  // slope = M·(dx, dy) of the true displacement, where M is in rad per pitch per px: pitch_px·P⁻¹
  // turns pixels into pixels along the lenslet axes, and 2π·w·p/(λ·f·m) turns those into radians
  // (docs/conventions.md, "Slopes, circulation, charge").
  float m11 = 0;
  float m12 = 0;
  float m21 = 0;
  float m22 = 0;

 private:
  void set_variances(const Sensor& sensor);
};

/// Computes the slopes s = w·G (rad per pitch, along column and row axis) and their noise from the
/// centroids. [rows, cols] of all three must agree. Variances and covariance pass through the same
/// linear map; systematic errors are not in them. A lenslet whose centroid is not valid is missing:
/// its `valid` is 0, and its other values are zeros. A spot exactly on its reference has a slope of
/// exactly 0.
void measure_slopes(const SlopePlan& plan, const Centroids& centroids, SlopeField& slopes) noexcept;

/// Computes slopes as measure_slopes() does, but keeps weak spots with the noise that they have.
/// Vortices sit in the dark, and a badly known slope is better than none where noise is accounted
/// for. A faint spot, or one at the edge of its window, has its slope. A lit lenslet without any
/// light above the threshold has the slope of the low orders (0 where windows stay) with
/// window_variance. Only lenslets that are
/// saturated or unlit, or have too many bad pixels, are missing.
void measure_weak_slopes(const SlopePlan& plan, const Centroids& centroids,
                         SlopeField& slopes) noexcept;

/// Computes the slopes of both functions above in one pass. From those of weak spots, the low
/// orders that windows follow are taken out. They are smooth but for a turn of the whole field, so
/// that what is left has the circulation of the vortices, and a missing slope's 0 stands amid
/// others about 0.
void measure_all_slopes(const SlopePlan& plan, const Centroids& centroids, SlopeField& weak,
                        SlopeField& slopes) noexcept;

/// Computes them for lenslet rows [first, last) only. n_valid stays; count_slopes() is due once all
/// rows are there.
void measure_all_slopes_rows(const SlopePlan& plan, const Centroids& centroids, int first, int last,
                             SlopeField& weak, SlopeField& slopes) noexcept;

/// Sets n_valid.
void count_slopes(SlopeField& slopes) noexcept;

/// Copies the slopes of valid lenslets from `weak` to `slopes`; all others are missing there. The
/// result is bit for bit that of measure_slopes(), but the slopes need not be computed twice.
void leave_out_weak(const Centroids& centroids, const SlopeField& weak,
                    SlopeField& slopes) noexcept;

}  // namespace curlew
