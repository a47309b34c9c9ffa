#include "centroiding/lenslet_grid_finder.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <map>
#include <numbers>
#include <queue>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "centroiding/lattice_vectors.h"
#include "centroiding/spot_picture.h"
#include "core/error.h"

namespace curlew {
namespace {

// Lengths in pitches.
constexpr double kSmooth = 0.10;      // of the Gaussian that spots are looked for with
constexpr double kSpotReach = 0.40;   // a spot is sought this far from its grid place
constexpr double kClear = 0.30;       // and is the brightest within this
constexpr double kSaddle = 0.42;      // its height is taken over what lies this far away
constexpr double kFloodReach = 0.30;  // a neighbour is where its neighbours say, within this

// A lit lenslet stands this far out of the noise,
constexpr double kNoises = 6.0;
// has more of its neighbours' height than what they spill, or than a sliver of a lenslet has,
constexpr double kLeastOfNearby = 0.12;
// more of everybody's than a ghost far out,
constexpr double kLeastOfAll = 0.004;
// and is not much sharper than the others: that is a hot spot.
constexpr double kLeastSharpness = 0.35;
// Beyond this, pixels are not square or the grid is sheared.
constexpr double kMostAnisotropy = 0.04;

template <typename... Parts>
std::string say(const Parts&... parts) {
  std::ostringstream text;
  text.precision(4);
  (text << ... << parts);
  return text.str();
}

using Index = std::pair<int, int>;  // (col, row), of any origin while the grid is sought

struct Spot {
  double x = 0.0;
  double y = 0.0;
  double height = 0.0;     // over its surroundings, in the smoothed picture
  double sharpness = 0.0;  // peak of the pixels over height
  bool cut = false;        // by the frame's rim, which shifts its centre of mass
};

using Spots = std::map<Index, Spot>;

double square(double x) { return x * x; }

/// What spots are looked for in.
struct Scene {
  Image<float> pixels;  // less background
  Image<float> smooth;
  double pitch = 0.0;
  double pixel_noise = 0.0;
  double noise = 0.0;  // of one pixel of `smooth`

  /// Between pixels, bilinearly.
  double smooth_at(double x, double y) const {
    const double cx = std::clamp(x, 0.0, smooth.cols() - 1.0);
    const double cy = std::clamp(y, 0.0, smooth.rows() - 1.0);
    const int c = std::min(static_cast<int>(cx), smooth.cols() - 2);
    const int r = std::min(static_cast<int>(cy), smooth.rows() - 2);
    const double u = cx - c;
    const double v = cy - r;
    const auto at = [&](int row, int col) { return static_cast<double>(smooth(row, col)); };
    return (1.0 - v) * ((1.0 - u) * at(r, c) + u * at(r, c + 1)) +
           v * ((1.0 - u) * at(r + 1, c) + u * at(r + 1, c + 1));
  }
};

bool on_frame(const Scene& scene, double x, double y) {
  return x >= -0.5 && y >= -0.5 && x < scene.smooth.cols() - 0.5 && y < scene.smooth.rows() - 0.5;
}

/// Calls visit(row, col) for every pixel on the frame within `radius` of (x, y).
template <typename Visit>
void for_each_within(const Scene& scene, double x, double y, double radius, Visit visit) {
  const int top = std::max(static_cast<int>(std::ceil(y - radius)), 0);
  const int bottom = std::min(static_cast<int>(std::floor(y + radius)), scene.smooth.rows() - 1);
  const int left = std::max(static_cast<int>(std::ceil(x - radius)), 0);
  const int right = std::min(static_cast<int>(std::floor(x + radius)), scene.smooth.cols() - 1);
  for (int r = top; r <= bottom; ++r) {
    for (int c = left; c <= right; ++c) {
      if (square(c - x) + square(r - y) <= radius * radius) visit(r, c);
    }
  }
}

/// How far the smoothed picture at (row, col) rises over the lower end of each line through it,
/// least of four directions. A streak that passes through rises over nothing along itself; the
/// slope towards a bright neighbour still falls on its far side.
double prominence(const Scene& scene, int row, int col) {
  const double here = static_cast<double>(scene.smooth(row, col));
  const double reach = std::max(kSaddle * scene.pitch, 1.5);
  double least = std::numeric_limits<double>::max();
  for (int k = 0; k < 4; ++k) {
    const double angle = k * std::numbers::pi / 4.0;
    const double dx = reach * std::cos(angle);
    const double dy = reach * std::sin(angle);
    double lower = std::numeric_limits<double>::max();
    for (double sign : {-1.0, 1.0}) {
      if (!on_frame(scene, col + sign * dx, row + sign * dy)) continue;
      lower = std::min(lower, scene.smooth_at(col + sign * dx, row + sign * dy));
    }
    if (lower < std::numeric_limits<double>::max()) least = std::min(least, here - lower);
  }
  return least;
}

bool is_brightest_around(const Scene& scene, int row, int col) {
  bool brightest = true;
  const float here = scene.smooth(row, col);
  for_each_within(scene, col, row, std::max(kClear * scene.pitch, 1.5),
                  [&](int r, int c) { brightest = brightest && scene.smooth(r, c) <= here; });
  return brightest;
}

/// Centre of mass of what exceeds a fifth of the peak, over the surroundings, near (col, row).
Spot measure_spot(const Scene& scene, int row, int col, double height) {
  const double radius = std::max(kClear * scene.pitch, 1.6);
  const double floor = static_cast<double>(scene.smooth(row, col)) - height;
  double peak = 0.0;
  for_each_within(scene, col, row, std::max(0.5 * radius, 1.0), [&](int r, int c) {
    peak = std::max(peak, static_cast<double>(scene.pixels(r, c)) - floor);
  });
  Spot spot{static_cast<double>(col), static_cast<double>(row), height, peak / height};
  for (int pass = 0; pass < 3; ++pass) {
    double sum = 0.0;
    double sum_x = 0.0;
    double sum_y = 0.0;
    for_each_within(scene, spot.x, spot.y, radius, [&](int r, int c) {
      const double light = static_cast<double>(scene.pixels(r, c)) - floor - 0.2 * peak;
      if (light <= 0.0) return;
      sum += light;
      sum_x += light * c;
      sum_y += light * r;
    });
    if (sum <= 0.0) break;
    spot.x = sum_x / sum;
    spot.y = sum_y / sum;
  }
  spot.cut = !on_frame(scene, spot.x - radius, spot.y - radius) ||
             !on_frame(scene, spot.x + radius, spot.y + radius);
  return spot;
}

/// Every local maximum that could be a spot.
std::vector<Spot> find_candidates(const Scene& scene) {
  std::vector<Spot> found;
  for (int r = 0; r < scene.smooth.rows(); ++r) {
    for (int c = 0; c < scene.smooth.cols(); ++c) {
      if (static_cast<double>(scene.smooth(r, c)) < kNoises * scene.noise ||
          !is_brightest_around(scene, r, c)) {
        continue;
      }
      const double height = prominence(scene, r, c);
      if (height > kNoises * scene.noise) found.push_back(measure_spot(scene, r, c, height));
    }
  }
  return found;
}

/// The brightest of the pixels around (row, col).
double brightest_neighbour(const Scene& scene, int row, int col) {
  double brightest = -std::numeric_limits<double>::max();
  for_each_within(scene, col, row, 1.5, [&](int r, int c) {
    if (r != row || c != col) {
      brightest = std::max(brightest, static_cast<double>(scene.pixels(r, c)));
    }
  });
  return brightest;
}

/// A hot pixel that sits on a spot hides from those who know no spots: it falls to its neighbours
/// much more steeply than the candidates do. True where one was replaced.
bool remove_hot_pixels_in_spots(Scene& scene, const std::vector<Spot>& candidates) {
  constexpr double kSteeper = 0.35;
  std::vector<float> spreads;
  for (const Spot& spot : candidates) {
    double peak = 0.0;
    int row = -1;
    int col = -1;
    for_each_within(scene, spot.x, spot.y, 2.0, [&](int r, int c) {
      if (static_cast<double>(scene.pixels(r, c)) <= peak) return;
      peak = static_cast<double>(scene.pixels(r, c));
      row = r;
      col = c;
    });
    if (row < 0) continue;
    spreads.push_back(static_cast<float>(brightest_neighbour(scene, row, col) / peak));
  }
  const double least = kSteeper * quantile(std::move(spreads), 0.5);
  const Image<float> before = scene.pixels;
  bool any = false;
  for (int r = 0; r < before.rows(); ++r) {
    for (int c = 0; c < before.cols(); ++c) {
      const double here = static_cast<double>(before(r, c));
      if (here < 8.0 * scene.pixel_noise) continue;
      const double next = brightest_neighbour(scene, r, c);
      if (next > least * here) continue;
      scene.pixels(r, c) = static_cast<float>(next);
      any = true;
    }
  }
  return any;
}

/// Column and row vectors of the grid, from two lattice vectors of either sign and order.
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

constexpr std::array<Index, 4> kNeighbours{{{1, 0}, {-1, 0}, {0, 1}, {0, -1}}};

/// Numbers the candidates by walking from neighbour to neighbour, brightest first, so that a
/// slow distortion can add up to more than a pitch.
class Flood {
 public:
  Flood(const std::vector<Spot>& candidates, const LensletGrid& grid)
      : candidates_(candidates), grid_(grid) {}

  Spots run() {
    const std::size_t seed = best_seed();
    take({0, 0}, seed);
    while (!open_.empty()) {
      const Index at = open_.top().second;
      open_.pop();
      for (const Index& step : kNeighbours) {
        const Index next{at.first + step.first, at.second + step.second};
        if (taken_.contains(next)) continue;
        const auto [x, y] = expect(next);
        const std::size_t near = nearest(x, y);
        if (near < candidates_.size()) take(next, near);
      }
    }
    return taken_;
  }

 private:
  /// The candidate nearest to (x, y) that is within reach; candidates_.size() if there is none.
  std::size_t nearest(double x, double y) const {
    std::size_t best = candidates_.size();
    double least = square(kFloodReach * grid_.pitch_px());
    for (std::size_t i = 0; i < candidates_.size(); ++i) {
      const double d = square(candidates_[i].x - x) + square(candidates_[i].y - y);
      if (d < least) {
        least = d;
        best = i;
      }
    }
    return best;
  }

  /// The one whose dimmest neighbour on four sides is brightest; failing that, on fewer sides.
  std::size_t best_seed() const {
    std::size_t best = 0;
    std::pair<int, double> best_score{-1, 0.0};
    for (std::size_t i = 0; i < candidates_.size(); ++i) {
      std::pair<int, double> score{0, candidates_[i].height};
      for (const auto& [dc, dr] : kNeighbours) {
        const std::size_t near = nearest(candidates_[i].x + grid_.p11 * dc + grid_.p12 * dr,
                                         candidates_[i].y + grid_.p21 * dc + grid_.p22 * dr);
        if (near == candidates_.size()) continue;
        ++score.first;
        score.second = std::min(score.second, candidates_[near].height);
      }
      if (score > best_score) {
        best_score = score;
        best = i;
      }
    }
    return best;
  }

  /// The mean of what the numbered spots around say.
  std::array<double, 2> expect(const Index& at) const {
    double x = 0.0;
    double y = 0.0;
    int n = 0;
    for (int dr = -1; dr <= 1; ++dr) {
      for (int dc = -1; dc <= 1; ++dc) {
        const auto it = taken_.find({at.first + dc, at.second + dr});
        if (it == taken_.end()) continue;
        x += it->second.x - grid_.p11 * dc - grid_.p12 * dr;
        y += it->second.y - grid_.p21 * dc - grid_.p22 * dr;
        ++n;
      }
    }
    return {x / n, y / n};
  }

  void take(const Index& at, std::size_t candidate) {
    taken_[at] = candidates_[candidate];
    open_.emplace(candidates_[candidate].height, at);
  }

  const std::vector<Spot>& candidates_;
  const LensletGrid& grid_;
  Spots taken_;
  std::priority_queue<std::pair<double, Index>> open_;
};

/// Least squares of x = origin + P·(col, row). Spots cut by the rim are left out, and what is
/// beyond three times the median distance: a smeared spot shall not tilt the grid. False where the
/// rest does not span a plane.
bool fit_grid(LensletGrid& grid, const Spots& spots) {
  const auto distance = [&grid](const Index& at, const Spot& spot) {
    const auto [x, y] = grid.pixel_from_lenslet(at.first, at.second);
    return std::hypot(spot.x - x, spot.y - y);
  };
  double limit = std::numeric_limits<double>::max();
  for (int pass = 0; pass < 4; ++pass) {
    Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
    Eigen::Matrix<double, 3, 2> right = Eigen::Matrix<double, 3, 2>::Zero();
    for (const auto& [at, spot] : spots) {
      if (spot.cut || distance(at, spot) > limit) continue;
      const Eigen::Vector3d place(1.0, at.first, at.second);
      normal += place * place.transpose();
      right += place * Eigen::RowVector2d(spot.x, spot.y);
    }
    const Eigen::FullPivLU<Eigen::Matrix3d> factors(normal);
    if (factors.rank() < 3) return false;
    const Eigen::Matrix<double, 3, 2> fit = factors.solve(right);
    grid.origin_x_px = fit(0, 0);
    grid.origin_y_px = fit(0, 1);
    grid.p11 = fit(1, 0);
    grid.p21 = fit(1, 1);
    grid.p12 = fit(2, 0);
    grid.p22 = fit(2, 1);
    std::vector<float> distances;
    for (const auto& [at, spot] : spots) {
      if (!spot.cut) distances.push_back(static_cast<float>(distance(at, spot)));
    }
    limit = std::max(3.0 * quantile(std::move(distances), 0.5), 0.05 * grid.pitch_px());
  }
  return true;
}

/// Grid places on the frame.
std::vector<Index> places_on_frame(const LensletGrid& grid, const Scene& scene) {
  double least_col = std::numeric_limits<double>::max();
  double least_row = least_col;
  double most_col = -least_col;
  double most_row = -least_col;
  for (double x : {0.0, scene.smooth.cols() - 1.0}) {
    for (double y : {0.0, scene.smooth.rows() - 1.0}) {
      const auto [col, row] = grid.lenslet_from_pixel(x, y);
      least_col = std::min(least_col, col);
      most_col = std::max(most_col, col);
      least_row = std::min(least_row, row);
      most_row = std::max(most_row, row);
    }
  }
  std::vector<Index> places;
  for (int r = static_cast<int>(std::floor(least_row)); r <= std::ceil(most_row); ++r) {
    for (int c = static_cast<int>(std::floor(least_col)); c <= std::ceil(most_col); ++c) {
      const auto [x, y] = grid.pixel_from_lenslet(c, r);
      if (on_frame(scene, x, y)) places.emplace_back(c, r);
    }
  }
  return places;
}

/// The noise of the smoothed picture midway between spots, from differences of neighbouring
/// corners: stripes and ghosts count, slow gradients do not.
double corner_noise(const LensletGrid& grid, const Scene& scene, const std::vector<Index>& places) {
  std::vector<float> differences;
  for (const auto& [c, r] : places) {
    const auto [x0, y0] = grid.pixel_from_lenslet(c + 0.5, r + 0.5);
    const auto [x1, y1] = grid.pixel_from_lenslet(c + 1.5, r + 0.5);
    if (!on_frame(scene, x0, y0) || !on_frame(scene, x1, y1)) continue;
    differences.push_back(
        static_cast<float>(std::abs(scene.smooth_at(x1, y1) - scene.smooth_at(x0, y0))));
  }
  return 1.4826 * quantile(std::move(differences), 0.5) / std::numbers::sqrt2;
}

/// Looks into every grid place on the frame for a spot of its own.
Spots find_lit(const LensletGrid& grid, const Scene& scene) {
  const std::vector<Index> places = places_on_frame(grid, scene);
  Spots seen;
  for (const Index& at : places) {
    const auto [x, y] = grid.pixel_from_lenslet(at.first, at.second);
    int best_row = -1;
    int best_col = -1;
    float best = -std::numeric_limits<float>::max();
    for_each_within(scene, x, y, std::max(kSpotReach * scene.pitch, 1.5), [&](int r, int c) {
      if (scene.smooth(r, c) <= best) return;
      best = scene.smooth(r, c);
      best_row = r;
      best_col = c;
    });
    if (best_row < 0 || !is_brightest_around(scene, best_row, best_col)) continue;
    const double height = prominence(scene, best_row, best_col);
    if (height > kNoises * scene.noise) {
      seen[at] = measure_spot(scene, best_row, best_col, height);
    }
  }

  std::vector<float> heights;
  for (const auto& [at, spot] : seen) heights.push_back(static_cast<float>(spot.height));
  const double typical = quantile(std::move(heights), 0.75);
  // Where spots crowd, their wings make the corners uneven; that is no reason to drop any.
  const double uneven = std::min(kNoises * corner_noise(grid, scene, places), 0.15 * typical);
  std::erase_if(seen, [&](const auto& entry) { return entry.second.height < uneven; });
  std::vector<float> sharpnesses;
  for (const auto& [at, spot] : seen) {
    if (spot.height > 0.3 * typical) sharpnesses.push_back(static_cast<float>(spot.sharpness));
  }
  const double sharpness = quantile(std::move(sharpnesses), 0.5);
  Spots lit;
  for (const auto& [at, spot] : seen) {
    if (spot.sharpness * kLeastSharpness > sharpness) continue;
    std::vector<float> nearby;
    for (int dr = -2; dr <= 2; ++dr) {
      for (int dc = -2; dc <= 2; ++dc) {
        const auto it = seen.find({at.first + dc, at.second + dr});
        if (it != seen.end()) nearby.push_back(static_cast<float>(it->second.height));
      }
    }
    if (nearby.size() == 1) continue;  // of no use alone, and more likely a blemish
    const double wanted =
        std::max(kLeastOfNearby * quantile(std::move(nearby), 0.75), kLeastOfAll * typical);
    if (spot.height > wanted) lit.emplace(at, spot);
  }
  return lit;
}

/// Ratio of the singular values of P, less 1.
double anisotropy_of(const LensletGrid& grid) {
  const double sum = std::hypot(grid.p11 + grid.p22, grid.p21 - grid.p12);
  const double difference = std::hypot(grid.p11 - grid.p22, grid.p21 + grid.p12);
  const double larger = 0.5 * (sum + difference);
  const double smaller = 0.5 * std::abs(sum - difference);
  return larger / smaller - 1.0;
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

FoundGrid make_found(LensletGrid grid, const Spots& lit) {
  Index low = lit.begin()->first;
  Index high = low;
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
  double sum = 0.0;
  int n_whole = 0;
  for (const auto& [at, spot] : lit) {
    const int c = at.first - low.first;
    const int r = at.second - low.second;
    found.lit(r, c) = 1;
    found.spot_x_px(r, c) = static_cast<float>(spot.x);
    found.spot_y_px(r, c) = static_cast<float>(spot.y);
    if (spot.cut) continue;
    const auto [gx, gy] = grid.pixel_from_lenslet(c, r);
    sum += square(spot.x - gx) + square(spot.y - gy);
    ++n_whole;
  }
  found.n_lit = static_cast<int>(lit.size());
  found.residual_px = std::sqrt(sum / n_whole);
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

FoundGrid find_lenslet_grid(const Image<float>& reference_adu, const Image<std::uint8_t>& bad_pixel,
                            bool mirrored) {
  const SpotPicture picture = clean_spot_picture(reference_adu, bad_pixel);
  const LatticeVectors vectors = find_lattice_vectors(picture);
  refuse_other_lattices(vectors);
  LensletGrid grid;
  orient(grid, vectors, mirrored);

  Scene scene;
  scene.pitch = grid.pitch_px();
  scene.pixels = picture.pixels_adu;
  for (float& v : scene.pixels) v -= static_cast<float>(picture.background_adu);
  const double smooth_px = std::max(kSmooth * scene.pitch, 0.6);
  scene.smooth = smooth_gaussian(scene.pixels, smooth_px);
  scene.pixel_noise = picture.noise_adu;
  scene.noise = picture.noise_adu / (2.0 * std::sqrt(std::numbers::pi) * smooth_px);

  std::vector<Spot> candidates = find_candidates(scene);
  if (remove_hot_pixels_in_spots(scene, candidates)) {
    scene.smooth = smooth_gaussian(scene.pixels, smooth_px);
    candidates = find_candidates(scene);
  }
  Spots spots;
  if (!candidates.empty()) spots = Flood(candidates, grid).run();
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
  if (found.anisotropy > kMostAnisotropy) {
    throw Failure(say("the spots' grid is stretched or sheared by ", 100.0 * found.anisotropy,
                      " %: use a sensor with square lenslets and square pixels"));
  }
  const Level between = measure_between_spots(picture.pixels_adu, found.grid);
  found.background_adu = between.median_adu;
  found.noise_adu = between.noise_adu;
  return found;
}

}  // namespace curlew
