// BeamFigures say where the beam is on the lenslets, how large it is, and whether the array's edge
// cuts it.
#pragma once

#include <array>
#include <cstdint>
#include <string>

#include "core/centroids.h"
#include "core/image.h"

namespace curlew {

/// The edges of the array of lit lenslets. Rows grow downwards, so the top is row 0.
enum class BeamEdge : std::uint8_t { kLeft, kRight, kTop, kBottom };
inline constexpr std::array kBeamEdgeNames = {"left", "right", "top", "bottom"};

/// Moments of the light over the lenslets, each of which counts at its centre. Lengths are in
/// lenslet units, so times the pitch they are lengths on the array. Everything but `light` is NaN
/// where there is no light.
struct BeamFigures {
  double light = 0.0;  ///< of all lenslets, in the unit of the map
  double x = 0.0;      ///< centroid
  double y = 0.0;
  /// Diameters D4σ = 4·(second central moment)^½ along the rows and the columns (ISO 11146-1, 2021,
  /// sec. 3.4): 1/e² diameters for a Gaussian beam.
  double d4sigma_x = 0.0;
  double d4sigma_y = 0.0;
  double rim =
      0.0;  ///< part of the light in lenslets that are the first or last of a row or column
  /// In the order of BeamEdge: the brightest lenslet of the rim that lies in this direction from
  /// the middle, over the brightest of all.
  std::array<double, kBeamEdgeNames.size()> edge{};

  bool is_lit() const { return light > 0.0; }
};

/// Measures the light of each lenslet, [rows, cols]; what is not above 0 counts as none. lit: 1
/// where a lenslet belongs to the array; the others do not count.
BeamFigures measure_beam(const Image<float>& light, const Image<std::uint8_t>& lit);

/// The same for one frame: its fluxes above level and threshold. Faint lenslets, whose flux may be
/// noise, count as dark.
BeamFigures measure_beam(const Image<float>& flux_adu, const Image<LensletState>& state);

/// Returns over which edges the beam leaves the array, more than the reference beam does, as "left
/// and top"; empty if over none. It leaves over an edge where lenslets have more than 1/e² of the
/// brightest one's light and those of the reference had less. Where the reference had more at two
/// opposite edges, it fills the array; then the beam leaves where its centroid has moved by over
/// half of the reference's σ, at which an evenly filled array has lost some quarter of its light.
std::string edges_that_cut(const BeamFigures& beam, const BeamFigures& reference);

}  // namespace curlew
