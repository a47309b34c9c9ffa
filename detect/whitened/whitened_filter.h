// The filter that sees a vortex best in the circulation round it, where slopes are as noisy as
// their lenslets are dark.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "core/image.h"
#include "core/slope_field.h"

namespace curlew {

/// The mean D of the 3×3 cells round a vortex: its own cell, those beside it, those at the corners.
/// Only the ratios count.
struct VortexPattern {
  float centre = 1.8F;
  float side = 0.3F;
  float corner = -0.25F;
};

inline constexpr float kDarkest = 0.02F;  ///< of the mean flux: darker is all the same
/// Variance of a slope that is missing or as good as that, rad²: of a spot that may be anywhere in
/// its window.
inline constexpr float kNoisiestSlope = 30.0F;

/// What the filter takes of a frame; lenslets and cells one wider than the array all round, where
/// everything is missing.
///
/// A lenslet acts on D through two numbers: main = ½(s_x − s_y), which it adds to the cell it is
/// the first corner of and takes from the one it is the last of, and anti = ½(s_x + s_y), added
/// where it is the second corner and taken where it is the third (see circulate()).
struct WhitenedPlanes {
  WhitenedPlanes(int lenslet_rows, int lenslet_cols);

  // Lenslets, [rows+2, cols+2]; (r, c) of the array is (r+1, c+1).
  Image<float> main;           ///< rad, 0 where missing
  Image<float> anti;           ///< likewise
  Image<float> half_variance;  ///< ½(noise + clutter), rad²: the variance of main and of anti
  Image<float> brightness;     ///< ln(flux over its mean + kDarkest), 0 where not known
  Image<float> known;          ///< 1 where brightness is, else 0
  // Cells, [rows+1, cols+1].
  Image<float> circulation;  ///< rad
  Image<float> variance;     ///< Σ half_variance, rad²
  Image<float> inverse;      ///< its inverse
  // Nodes, [rows−1, cols−1].
  Image<float> darkness;  ///< mean brightness round the node's own four lenslets less theirs
  Image<float> margin;    ///< not below 0 where a closer look pays

  float mean_flux_adu = 0;
  /// Noise variance of a slope where the flux is the mean, rad². Noise goes nearly with 1/flux,
  /// while the variance that a centroid of few photons has for itself is worth little: it is 0 for
  /// a spot of one pixel.
  float noise_rad2 = 0;
};

/// Fills all but darkness and margin. lenslet_valid, [rows, cols]: where the sensor has a lenslet;
/// there the flux is known even if the slope is not.
void fill_planes(const SlopeField& slopes, const Image<float>& flux_adu,
                 const Image<std::uint8_t>& lenslet_valid, float clutter_rad2,
                 WhitenedPlanes& planes) noexcept;

/// The least that makes a node worth a closer look.
struct FirstLook {
  VortexPattern pattern{};
  float min_t_squared = 0;  ///< were all lenslets as noisy as one of mean flux
  // z ≥ offset − per_darkness·darkness + per_log_information·ln(information)
  float offset = 0;
  float per_darkness = 0;
  float per_log_information = 0;
};

/// Fills planes.darkness and planes.margin.
void look_over(const FirstLook& look, WhitenedPlanes& planes) noexcept;

/// The filter at one node: w = Σ⁻¹m.
struct NodeFilter {
  std::array<float, 9> weights{};  ///< of the cells, in raster order
  float sum = 0;                   ///< wᵀd, rad over the pattern's unit
  float information = 0;           ///< mᵀΣ⁻¹m
};
NodeFilter filter_at(const WhitenedPlanes& planes, const VortexPattern& pattern, int row,
                     int col) noexcept;

/// Variance of wᵀd from the slopes' own variances and covariances, exactly; missing slopes have
/// none.
float noise_variance(const SlopeField& slopes, const NodeFilter& filter, int row, int col) noexcept;

/// ln x for x > 0 to 2e-4, in instructions that make vectors.
float quick_log(float x) noexcept;

}  // namespace curlew
