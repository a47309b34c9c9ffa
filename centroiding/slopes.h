// Centroids to slopes: displacements from the reference, along the lenslet axes, in radians.
#pragma once

#include "centroiding/sensor.h"
#include "core/centroids.h"
#include "core/image.h"
#include "core/slope_field.h"

namespace curlew {

/// What turns a displacement into a slope, lenslet by lenslet.
struct SlopePlan {
  /// Throws Failure when optics or grid cannot give a slope: a length that is unknown or not
  /// positive, a grid without area, a lenslet without reference or gain.
  explicit SlopePlan(const Sensor& sensor);

  Image<float> ref_x_px;  ///< [rows, cols] of lenslets; 0 where not valid
  Image<float> ref_y_px;
  Image<float> inverse_gain_x;
  Image<float> inverse_gain_y;
  /// Relative error of the gain, half of what it lies below the median lenslet's: a window whose
  /// light reaches its edge is linear only for small displacements. A displacement d adds
  /// (error·d)² to the variance.
  Image<float> gain_error_x;
  Image<float> gain_error_y;
  float spot_variance_px2 = 0;   ///< of a spot's core, for weak ones that cannot tell theirs
  Image<float> window_variance;  ///< of a spot that may be anywhere in its window, rad²

  // slope = M·(dx/gain_x, dy/gain_y), rad per pitch per px: pitch_px·P⁻¹ turns pixels into pixels
  // along the lenslet axes, 2π·w·p/(λ·f·m) those into radians (DESIGN.md, Conventions).
  float m11 = 0;
  float m12 = 0;
  float m21 = 0;
  float m22 = 0;
};

/// Slopes s = w·G (rad per pitch, along column and row axis) and their noise from the centroids;
/// [rows, cols] of all three must agree. Variances and covariance pass through the same linear map.
/// A lenslet whose centroid is not valid is missing: valid 0 and zeros. A spot exactly on its
/// reference has a slope of exactly 0.
void measure_slopes(const SlopePlan& plan, const Centroids& centroids, SlopeField& slopes) noexcept;

/// The same, but weak spots count, with the noise they have: vortices sit in the dark, and a slope
/// known badly is better than none where noise is accounted for. A faint spot, or one at the edge
/// of its window, has its slope; where a lit lenslet shows nothing above the threshold the slope is
/// 0 with window_variance. Missing are only lenslets that are saturated or have bad pixels, or that
/// the sensor does not have.
void measure_weak_slopes(const SlopePlan& plan, const Centroids& centroids,
                         SlopeField& slopes) noexcept;

/// Of weak slopes those that measure_slopes gives, bit for bit where lenslets are valid: the maps
/// are read once and not measured twice.
void leave_out_weak(const Centroids& centroids, const SlopeField& weak,
                    SlopeField& slopes) noexcept;

}  // namespace curlew
