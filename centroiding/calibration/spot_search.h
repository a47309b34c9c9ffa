// This file declares the search for spots: local maxima of a spot picture that stand out of their
// surroundings.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "centroiding/calibration/spot_picture.h"
#include "core/image.h"

namespace curlew {

/// A spot stands this many standard deviations out of the noise.
inline constexpr double kSpotNoises = 6.0;

struct Spot {
  double x = 0.0;          ///< px, column; centre of mass of the light above a fifth of the peak
  double y = 0.0;          ///< px, row
  double height = 0.0;     ///< ADU above the surroundings, in the smoothed picture
  double sharpness = 0.0;  ///< peak of the unsmoothed pixels over height
  bool cut = false;        ///< true if the frame's rim cuts it, which shifts its centre of mass
};

/// Spots are sought in this scene. Both images are [rows, cols] of the frame.
struct SpotScene {
  Image<float> pixels;       ///< ADU, less background
  Image<float> smooth;       ///< `pixels`, smoothed by a Gaussian of a tenth of a pitch
  double pitch = 0.0;        ///< px
  double pixel_noise = 0.0;  ///< ADU, noise of one pixel of `pixels`
  double noise = 0.0;        ///< ADU, noise of one pixel of `smooth`
  double matters = 0.0;      ///< ADU, as in SpotPicture
  Image<std::uint8_t> hot;   ///< 1 where a hot pixel was replaced

  /// Returns the smoothed light in ADU, interpolated bilinearly between pixels; x and y are in px
  /// and held within the frame.
  double smooth_at(double x, double y) const;
  /// Returns whether (x, y) in px lies on a pixel.
  bool on_frame(double x, double y) const;
};

/// Subtracts the background from the picture and smooths it for spots `pitch_px` apart.
SpotScene make_spot_scene(const SpotPicture& picture, double pitch_px);

/// Returns every local maximum that could be a spot, row by row. Before that, hot pixels that sit
/// on spots are taken out of the scene.
std::vector<Spot> find_candidates(SpotScene& scene);

/// Returns the spot that belongs to the grid place (x, y) in px, or nothing where none stands out
/// there.
std::optional<Spot> find_spot_at(const SpotScene& scene, double x, double y);

}  // namespace curlew
