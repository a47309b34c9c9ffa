// A TurbulentPath is the air between transmitter and lenslets; the grid it is simulated on is here,
// too.
#pragma once

#include <cstddef>
#include <vector>

namespace curlew {

/// Says how the air of one phase screen drifts across the path: Taylor's frozen flow.
struct Wind {
  double x = 0.0;  ///< pitches a frame
  double y = 0.0;  ///< pitches a frame
};

/// Describes a path of length L through uniform von Kármán turbulence. Lengths across the path are
/// in √(λL), the Fresnel length: nothing else of λ and L enters paraxial propagation.
struct TurbulentPath {
  double rytov_variance = 1.0;  ///< that of a plane wave, 1.23 Cn² k^(7/6) L^(11/6), k = 2π/λ
  double lenslet = 0.064;       ///< side of a lenslet, √(λL)
  double outer_scale = 400.0;   ///< L0, √(λL): 100 m where √(λL) is .25 m
  double inner_scale = 0.02;    ///< l0, √(λL): 5 mm where √(λL) is .25 m
  int screens = 10;             ///< number of screens, each in the middle of its slab
  /// Radius at which a Gaussian beam, collimated where it starts, has 1/e² of its intensity, √(λL).
  /// 0 means a plane wave, on a periodic grid.
  double waist = 0.0;
  /// Without wind every frame is a realisation of its own. With it, frames are one realisation as
  /// it drifts. One velocity is that of all screens; several are those of screens at equal
  /// distances from the first to the last, and screens between them are interpolated. A screen
  /// comes round again when it has drifted by the width of the grid.
  std::vector<Wind> wind;
  int grid = 0;          ///< points per side; 0 lets choose_grid choose
  int grid_samples = 0;  ///< points per lenslet side; 0 makes a spacing of .008 √(λL) at most
};

/// Returns the set-up of M. Chen, F. S. Roux and J. C. Olivier, J. Opt. Soc. Am. A 24, 1994 (2007):
/// a Gaussian beam over 100 km with Cn² = 4e-18 m^(−2/3) and 10 screens. The paper leaves the rest
/// open; here λ is 633 nm, the waist is .3 m, the grid has 1024² points of 2 mm, L0 is 100 m, l0 is
/// 5 mm, and lenslets are 20 mm wide.
TurbulentPath chen2007_path();

/// Returns 1.23 Cn² k^(7/6) L^(11/6).
double rytov_variance(double cn2, double wavelength_m, double path_m);

/// Returns the whole path's r0 for a plane wave, √(λL): (.423 k² Cn² L)^(−3/5). It is infinite in
/// still air.
double fried_parameter(const TurbulentPath& path);

/// Returns the wind at screen `screen`, by interpolation; zero if the path has none.
Wind wind_at_screen(const TurbulentPath& path, int screen);

/// Holds the points that a path is simulated on, and those that its field is delivered on.
struct PropagationGrid {
  int points = 0;               ///< points per side, with the array in the middle
  int samples_per_lenslet = 0;  ///< points per lenslet side
  int finer = 1;                ///< the delivered field has this many points per point, each way
  int margin = 0;               ///< lenslets delivered beyond the array on each side
  double spacing = 0.0;         ///< distance between points, √(λL)
  std::size_t memory_bytes = 0;
};

/// Chooses the grid for rows × cols lenslets. Unless the path gives its points, a plane wave's is
/// at least 4 √(λL) wide, and a beam's at least 6 of its radii where it arrives. At least
/// `min_samples` points per lenslet side are delivered. Throws UsageError for a path that makes no
/// sense or a grid too small for the array.
PropagationGrid choose_grid(const TurbulentPath& path, int rows, int cols, int min_samples);

}  // namespace curlew
