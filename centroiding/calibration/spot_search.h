// Spot search: local maxima of a spot picture that stand out of their surroundings.
#pragma once

#include <optional>
#include <vector>

#include "centroiding/calibration/spot_picture.h"
#include "core/image.h"

namespace curlew {

/// A spot stands this many standard deviations out of the noise.
inline constexpr double kSpotNoises = 6.0;

struct Spot {
  double x = 0.0;          ///< px, column; centre of mass of what exceeds a fifth of the peak
  double y = 0.0;          ///< px, row
  double height = 0.0;     ///< ADU over its surroundings, in the smoothed picture
  double sharpness = 0.0;  ///< peak of the pixels over height
  bool cut = false;        ///< by the frame's rim, which shifts its centre of mass
};

/// What spots are looked for in. Both images are [rows, cols] of the frame.
struct SpotScene {
  Image<float> pixels;       ///< ADU, less background
  Image<float> smooth;       ///< the same, smoothed by a Gaussian of a tenth of a pitch
  double pitch = 0.0;        ///< px
  double pixel_noise = 0.0;  ///< ADU, of one pixel of `pixels`
  double noise = 0.0;        ///< ADU, of one pixel of `smooth`

  /// ADU between pixels, bilinearly; x, y in px, held within the frame.
  double smooth_at(double x, double y) const;
  /// Whether (x, y) in px lies on a pixel.
  bool on_frame(double x, double y) const;
};

/// The picture less its background, smoothed for spots `pitch_px` apart.
SpotScene make_spot_scene(const SpotPicture& picture, double pitch_px);

/// Every local maximum that could be a spot, row by row. Hot pixels that sit on spots are taken
/// out of the scene first.
std::vector<Spot> find_candidates(SpotScene& scene);

/// The spot that belongs to the grid place (x, y) in px; none where nothing stands out there.
std::optional<Spot> find_spot_at(const SpotScene& scene, double x, double y);

}  // namespace curlew
