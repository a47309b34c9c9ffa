#include "centroiding/calibration/lenslet_grid_finder.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <utility>
#include <vector>

#include "centroiding/calibration/grid_fit.h"
#include "centroiding/calibration/lattice_vectors.h"
#include "centroiding/calibration/sentence.h"
#include "centroiding/calibration/spot_indexing.h"
#include "centroiding/calibration/spot_picture.h"
#include "centroiding/calibration/spot_search.h"
#include "core/error.h"

namespace curlew {
namespace {

// A lit lenslet must pass four tests. First, it stands kSpotNoises out of the noise. Second, it has
// more than this fraction of its neighbours' height, which is more than they spill onto it, and
// more than a sliver of a lenslet has.
constexpr double kMinOfNearby = 0.12;
// Third, it has more than this fraction of the typical height of all spots, which is more than a
// ghost far out has.
constexpr double kMinOfAll = 0.004;
// Fourth, its sharpness is at most that of the typical spot over this number. A hot spot is
// sharper.
constexpr double kMinSharpness = 0.35;
// Beyond this anisotropy the pixels are not square or the grid is sheared.
constexpr double kMaxAnisotropy = 0.04;

/// Sets the column and row vectors of the grid from two lattice vectors, which may have any sign
/// and order.
void orient(LensletGrid& grid, const LatticeVectors& v, bool mirrored) {
  std::array<double, 2> column = v.a;
  std::array<double, 2> row = v.b;
  if (std::abs(column[0]) < std::abs(row[0])) std::swap(column, row);
  if (column[0] < 0.0) column = {-column[0], -column[1]};
  if ((row[1] < 0.0) != mirrored) row = {-row[0], -row[1]};
  grid.p11 = column[0];
  grid.p21 = column[1];
  grid.p12 = row[0];
  grid.p22 = row[1];
}

/// Returns all grid places on the frame.
std::vector<LensletIndex> places_on_frame(const LensletGrid& grid, const SpotScene& scene) {
  double min_col = std::numeric_limits<double>::max();
  double min_row = min_col;
  double max_col = -min_col;
  double max_row = -min_col;
  for (double x : {0.0, scene.smooth.cols() - 1.0}) {
    for (double y : {0.0, scene.smooth.rows() - 1.0}) {
      const auto [col, row] = grid.lenslet_from_pixel(x, y);
      min_col = std::min(min_col, col);
      max_col = std::max(max_col, col);
      min_row = std::min(min_row, row);
      max_row = std::max(max_row, row);
    }
  }
  std::vector<LensletIndex> places;
  for (int r = static_cast<int>(std::floor(min_row)); r <= std::ceil(max_row); ++r) {
    for (int c = static_cast<int>(std::floor(min_col)); c <= std::ceil(max_col); ++c) {
      const auto [x, y] = grid.pixel_from_lenslet(c, r);
      if (scene.on_frame(x, y)) places.emplace_back(c, r);
    }
  }
  return places;
}

/// Returns the noise of the smoothed picture midway between spots, from differences of neighbouring
/// corners of lenslets. Stripes and ghosts add to it, slow gradients do not.
double corner_noise(const LensletGrid& grid, const SpotScene& scene,
                    const std::vector<LensletIndex>& places) {
  std::vector<float> differences;
  for (const auto& [c, r] : places) {
    const auto [x0, y0] = grid.pixel_from_lenslet(c + 0.5, r + 0.5);
    const auto [x1, y1] = grid.pixel_from_lenslet(c + 1.5, r + 0.5);
    if (!scene.on_frame(x0, y0) || !scene.on_frame(x1, y1)) continue;
    differences.push_back(
        static_cast<float>(std::abs(scene.smooth_at(x1, y1) - scene.smooth_at(x0, y0))));
  }
  return 1.4826 * quantile(std::move(differences), 0.5) / std::numbers::sqrt2;
}

/// Looks at every grid place on the frame for a spot of its own.
IndexedSpots find_lit(const LensletGrid& grid, const SpotScene& scene) {
  const std::vector<LensletIndex> places = places_on_frame(grid, scene);
  IndexedSpots seen;
  for (const LensletIndex& at : places) {
    const auto [x, y] = grid.pixel_from_lenslet(at.first, at.second);
    if (const std::optional<Spot> spot = find_spot_at(scene, x, y)) seen[at] = *spot;
  }

  std::vector<float> heights;
  for (const auto& [at, spot] : seen) heights.push_back(static_cast<float>(spot.height));
  const double typical = quantile(std::move(heights), 0.75);
  // Where spots crowd, their wings make the corners uneven. The limit of .15 keeps that from
  // dropping any spot.
  const double uneven = std::min(kSpotNoises * corner_noise(grid, scene, places), 0.15 * typical);
  std::erase_if(seen, [&](const auto& entry) { return entry.second.height < uneven; });
  std::vector<float> sharpnesses;
  for (const auto& [at, spot] : seen) {
    if (spot.height > 0.3 * typical) sharpnesses.push_back(static_cast<float>(spot.sharpness));
  }
  const double sharpness = quantile(std::move(sharpnesses), 0.5);
  IndexedSpots lit;
  for (const auto& [at, spot] : seen) {
    if (spot.sharpness * kMinSharpness > sharpness) continue;
    std::vector<float> nearby;
    for (int dr = -2; dr <= 2; ++dr) {
      for (int dc = -2; dc <= 2; ++dc) {
        const auto it = seen.find({at.first + dc, at.second + dr});
        if (it != seen.end()) nearby.push_back(static_cast<float>(it->second.height));
      }
    }
    // A spot alone is of no use, and is more likely a blemish.
    if (nearby.size() == 1) continue;
    const double wanted =
        std::max(kMinOfNearby * quantile(std::move(nearby), 0.75), kMinOfAll * typical);
    if (spot.height > wanted) lit.emplace(at, spot);
  }
  return lit;
}

void refuse_other_lattices(const LatticeVectors& v) {
  const double a = std::hypot(v.a[0], v.a[1]);
  const double b = std::hypot(v.b[0], v.b[1]);
  if (v.kind == LatticeKind::kHexagonal) {
    throw Failure(say("the lenslet grid is hexagonal (pitch ", 0.5 * (a + b), " px, axes ",
                      v.angle_deg(), "° apart): only square grids can be used for now"));
  }
  if (v.kind == LatticeKind::kOther) {
    throw Failure(say("the spots form no square grid (they repeat every ", a, " px and ", b,
                      " px at ", v.angle_deg(),
                      "°): use a sensor with square lenslets and square pixels"));
  }
}

/// Interpolates bilinearly between the values of an image, and holds the place within it.
float interpolate(const Image<float>& image, double row, double col) {
  const double y = std::clamp(row, 0.0, image.rows() - 1.0);
  const double x = std::clamp(col, 0.0, image.cols() - 1.0);
  const int r = std::min(static_cast<int>(y), image.rows() - 2);
  const int c = std::min(static_cast<int>(x), image.cols() - 2);
  const auto v = static_cast<float>(y - r);
  const auto u = static_cast<float>(x - c);
  return (1.0F - v) * ((1.0F - u) * image(r, c) + u * image(r, c + 1)) +
         v * ((1.0F - u) * image(r + 1, c) + u * image(r + 1, c + 1));
}

FoundGrid make_found(LensletGrid grid, const IndexedSpots& lit) {
  LensletIndex low = lit.begin()->first;
  LensletIndex high = low;
  for (const auto& [at, spot] : lit) {
    low = {std::min(low.first, at.first), std::min(low.second, at.second)};
    high = {std::max(high.first, at.first), std::max(high.second, at.second)};
  }
  const auto [x, y] = grid.pixel_from_lenslet(low.first, low.second);
  grid.origin_x_px = x;
  grid.origin_y_px = y;
  grid.cols = high.first - low.first + 1;
  grid.rows = high.second - low.second + 1;

  constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
  FoundGrid found;
  found.grid = grid;
  found.lit = Image<std::uint8_t>(grid.rows, grid.cols, 0);
  found.spot_x_px = Image<float>(grid.rows, grid.cols, kNaN);
  found.spot_y_px = Image<float>(grid.rows, grid.cols, kNaN);
  IndexedSpots placed;
  for (const auto& [at, spot] : lit) {
    const int c = at.first - low.first;
    const int r = at.second - low.second;
    found.lit(r, c) = 1;
    found.spot_x_px(r, c) = static_cast<float>(spot.x);
    found.spot_y_px(r, c) = static_cast<float>(spot.y);
    placed.emplace(LensletIndex{c, r}, spot);
  }
  found.n_lit = static_cast<int>(lit.size());
  found.residual_px = rms_distance_px(grid, placed);
  found.anisotropy = anisotropy_of(grid);
  return found;
}

}  // namespace

Level measure_between_spots(const Image<float>& image_adu, const LensletGrid& grid) {
  constexpr double kFromMidway = 0.15;  // pitches
  std::vector<float> levels;
  std::vector<float> differences;
  for (int r = 0; r < image_adu.rows(); ++r) {
    for (int c = 0; c + 1 < image_adu.cols(); ++c) {
      const auto [col, row] = grid.lenslet_from_pixel(c + 0.5, r);
      if (std::abs(col - std::floor(col) - 0.5) <= kFromMidway &&
          std::abs(row - std::floor(row) - 0.5) <= kFromMidway) {
        levels.push_back(image_adu(r, c));
        differences.push_back(std::abs(image_adu(r, c + 1) - image_adu(r, c)));
      }
    }
  }
  return {quantile(std::move(levels), 0.5),
          1.4826 * quantile(std::move(differences), 0.5) / std::numbers::sqrt2};
}

Image<float> map_between_spots(const Image<float>& image_adu, const LensletGrid& grid) {
  constexpr double kFromMidway = 0.2;  // pitches
  // Corner (r, c) is the one before lenslet (r, c), in a frame of two corners more on each side.
  constexpr int kRim = 2;
  const int rows = grid.rows + 2 * kRim;
  const int cols = grid.cols + 2 * kRim;
  Image<std::vector<float>> values(rows, cols);
  for (int r = 0; r < image_adu.rows(); ++r) {
    for (int c = 0; c < image_adu.cols(); ++c) {
      const auto [col, row] = grid.lenslet_from_pixel(c, r);
      const double u = col + 0.5;
      const double v = row + 0.5;
      const int at_col = static_cast<int>(std::lround(u)) + kRim;
      const int at_row = static_cast<int>(std::lround(v)) + kRim;
      if (!values.contains(at_row, at_col) || std::abs(u - std::round(u)) > kFromMidway ||
          std::abs(v - std::round(v)) > kFromMidway) {
        continue;
      }
      values(at_row, at_col).push_back(image_adu(r, c));
    }
  }
  Image<float> corners(rows, cols);
  for (int r = 0; r < rows; ++r) {
    for (int c = 0; c < cols; ++c) {
      std::vector<float> near;
      for (int reach = 1; near.empty() && reach < std::max(rows, cols); ++reach) {
        for (int dr = -reach; dr <= reach; ++dr) {
          for (int dc = -reach; dc <= reach; ++dc) {
            if (!values.contains(r + dr, c + dc)) continue;
            const std::vector<float>& more = values(r + dr, c + dc);
            near.insert(near.end(), more.begin(), more.end());
          }
        }
      }
      corners(r, c) = static_cast<float>(quantile(std::move(near), 0.5));
    }
  }
  Image<float> map(image_adu.rows(), image_adu.cols());
  for (int r = 0; r < map.rows(); ++r) {
    for (int c = 0; c < map.cols(); ++c) {
      const auto [col, row] = grid.lenslet_from_pixel(c, r);
      map(r, c) = interpolate(corners, row + 0.5 + kRim, col + 0.5 + kRim);
    }
  }
  return map;
}

FoundGrid find_lenslet_grid(const Image<float>& reference_adu, const Image<std::uint8_t>& bad_pixel,
                            bool mirrored) {
  const SpotPicture picture = clean_spot_picture(reference_adu, bad_pixel);
  const LatticeVectors vectors = find_lattice_vectors(picture);
  refuse_other_lattices(vectors);
  LensletGrid grid;
  orient(grid, vectors, mirrored);

  SpotScene scene = make_spot_scene(picture, grid.pitch_px());
  IndexedSpots spots = index_spots(find_candidates(scene), grid);
  bool fitted = fit_grid(grid, spots);
  for (int pass = 0; fitted && pass < 3; ++pass) {
    spots = find_lit(grid, scene);
    fitted = fit_grid(grid, spots);
  }
  if (!fitted || spots.size() < 4) {
    throw Failure(say("no grid of spots: the reference frame repeats every ", scene.pitch,
                      " px, but only ", spots.size(),
                      " spots stand out; give it more light, or average more frames"));
  }
  FoundGrid found = make_found(grid, spots);
  if (found.anisotropy > kMaxAnisotropy) {
    throw Failure(say("the spots' grid is stretched or sheared by ", 100.0 * found.anisotropy,
                      " %: use a sensor with square lenslets and square pixels"));
  }
  const Level between = measure_between_spots(picture.pixels_adu, found.grid);
  found.background_adu = between.median_adu;
  found.noise_adu = between.noise_adu;
  found.hot = std::move(scene.hot);
  found.border = picture.border;
  return found;
}

}  // namespace curlew
