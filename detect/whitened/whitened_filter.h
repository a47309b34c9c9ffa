// This file declares the filter that sees a vortex best in the circulation round it, where slopes
// are noisier the darker their lenslets are.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "core/image.h"
#include "core/slope_field.h"

namespace curlew {

/// This is the mean D of the 3×3 cells round a vortex: of its own cell, of those beside it, and of
/// those at the corners. Only the ratios count.
struct VortexPattern {
  float centre = 1.8F;
  float side = 0.3F;
  float corner = -0.25F;

  bool operator==(const VortexPattern&) const = default;
};

inline constexpr float kDarkest = 0.02F;  ///< of the mean flux; all below is equally dark
/// This is the variance, in rad², of a slope that is missing or tells as little as a missing one.
/// It is that of a spot that may be anywhere in its window.
inline constexpr float kNoisiestSlope = 30.0F;

/// Holds what the filter needs of a frame. Lenslets and cells are one wider than the array all
/// round, and everything in that ring is missing.
///
/// A lenslet acts on D through two numbers. The first is main = ½(s_x − s_y), which counts positive
/// in the cell of which the lenslet is the first corner and negative in the cell of which it is the
/// last. The second is anti = ½(s_x + s_y), which counts positive where it is the second corner and
/// negative where it is the third (see circulate()).
struct WhitenedPlanes {
  WhitenedPlanes(int lenslet_rows, int lenslet_cols);

  // Maps of lenslets are [rows+2, cols+2]; (r, c) of the array is (r+1, c+1).
  Image<float> main;           ///< rad, 0 where missing
  Image<float> anti;           ///< rad, 0 where missing
  Image<float> half_variance;  ///< ½(noise + clutter), rad²: the variance of main and of anti
  Image<float> brightness;     ///< ln(flux over its mean + kDarkest), 0 where not known
  Image<float> known;          ///< 1 where the brightness is known, else 0
  // Maps of cells are [rows+1, cols+1].
  Image<float> circulation;  ///< rad
  Image<float> variance;     ///< sum of the four half_variance, rad²
  Image<float> inverse;      ///< 1/variance
  // Maps of nodes are [rows−1, cols−1].
  Image<float> darkness;  ///< mean brightness round the node's four lenslets less their own
  /// t² if all lenslets were as noisy as one of mean flux; −1 where z is too small for a closer
  /// look
  Image<float> first_t_squared;

  float mean_flux_adu = 0;
  /// This is the noise variance of a slope where the flux is the mean, in rad². Noise goes nearly
  /// with 1/flux. The variance that a centroid of few photons states for itself is worth little: it
  /// is 0 for a spot of one pixel.
  float noise_rad2 = 0;
};

/// Fills all planes but those of nodes. lenslet_valid, [rows, cols], says where the sensor has
/// a lenslet; there the flux is known even if the slope is not.
void fill_planes(const SlopeField& slopes, const Image<float>& flux_adu,
                 const Image<std::uint8_t>& lenslet_valid, float clutter_rad2,
                 WhitenedPlanes& planes) noexcept;

/// A node must reach at least z = offset − per_darkness·darkness + per_log_information·
/// ln(information) to be worth a closer look.
struct FirstLook {
  VortexPattern pattern{};
  float offset = 0;
  float per_darkness = 0;
  float per_log_information = 0;
};

/// Fills the planes of nodes.
void look_over(const FirstLook& look, WhitenedPlanes& planes) noexcept;

/// This is the filter at one node: w = Σ⁻¹m.
struct NodeFilter {
  std::array<float, 9> weights{};  ///< weights of the cells, in raster order
  float sum = 0;                   ///< wᵀd, in rad over the pattern's unit
  float information = 0;           ///< mᵀΣ⁻¹m
};
NodeFilter filter_at(const WhitenedPlanes& planes, const VortexPattern& pattern, int row,
                     int col) noexcept;

/// Returns the variance of wᵀd from the slopes' own variances and covariances, exactly. Missing
/// slopes add nothing.
float noise_variance(const SlopeField& slopes, const NodeFilter& filter, int row, int col) noexcept;

/// Returns ln x for x > 0, to 2e-4, in instructions of which the compiler makes vectors.
float quick_log(float x) noexcept;

}  // namespace curlew
