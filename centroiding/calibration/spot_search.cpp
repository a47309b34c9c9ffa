#include "centroiding/calibration/spot_search.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

namespace curlew {
namespace {

// These lengths are in pitches.
constexpr double kSmooth = 0.10;     // σ of the Gaussian that smooths the picture
constexpr double kSpotReach = 0.40;  // A spot is sought within this distance of its grid place.
constexpr double kClear = 0.30;      // It must be the brightest within this distance.
constexpr double kSaddle = 0.42;     // Its height is measured from what lies this far away.

double square(double x) { return x * x; }

double smoothing_px(double pitch_px) { return std::max(kSmooth * pitch_px, 0.6); }

/// Calls visit(row, col) for every pixel on the frame within `radius` of (x, y).
template <typename Visit>
void for_each_within(const SpotScene& scene, double x, double y, double radius, Visit visit) {
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

/// Returns how far the smoothed picture at (row, col) rises above the lower end of a line through
/// it, for that one of four directions in which it rises least. A streak that passes through does
/// not rise along itself. The slope towards a bright neighbour still falls on its far side.
double prominence(const SpotScene& scene, int row, int col) {
  const auto here = static_cast<double>(scene.smooth(row, col));
  const double reach = std::max(kSaddle * scene.pitch, 1.5);
  double minimum = std::numeric_limits<double>::max();
  for (int k = 0; k < 4; ++k) {
    const double angle = k * std::numbers::pi / 4.0;
    const double dx = reach * std::cos(angle);
    const double dy = reach * std::sin(angle);
    double lower = std::numeric_limits<double>::max();
    for (double sign : {-1.0, 1.0}) {
      if (!scene.on_frame(col + sign * dx, row + sign * dy)) continue;
      lower = std::min(lower, scene.smooth_at(col + sign * dx, row + sign * dy));
    }
    if (lower < std::numeric_limits<double>::max()) minimum = std::min(minimum, here - lower);
  }
  return minimum;
}

bool is_brightest_around(const SpotScene& scene, int row, int col) {
  bool brightest = true;
  const float here = scene.smooth(row, col);
  for_each_within(scene, col, row, std::max(kClear * scene.pitch, 1.5),
                  [&](int r, int c) { brightest = brightest && scene.smooth(r, c) <= here; });
  return brightest;
}

/// Measures a spot near (col, row): the centre of mass of the light, above the surroundings, that
/// exceeds a fifth of the peak.
Spot measure_spot(const SpotScene& scene, int row, int col, double height) {
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
  spot.cut = !scene.on_frame(spot.x - radius, spot.y - radius) ||
             !scene.on_frame(spot.x + radius, spot.y + radius);
  return spot;
}

/// Finds every local maximum that could be a spot.
std::vector<Spot> find_maxima(const SpotScene& scene) {
  std::vector<Spot> found;
  for (int r = 0; r < scene.smooth.rows(); ++r) {
    for (int c = 0; c < scene.smooth.cols(); ++c) {
      if (static_cast<double>(scene.smooth(r, c)) < kSpotNoises * scene.noise ||
          !is_brightest_around(scene, r, c)) {
        continue;
      }
      const double height = prominence(scene, r, c);
      if (height > kSpotNoises * scene.noise) found.push_back(measure_spot(scene, r, c, height));
    }
  }
  return found;
}

/// Returns the brightest of the pixels around (row, col).
double brightest_neighbour(const SpotScene& scene, int row, int col) {
  double brightest = -std::numeric_limits<double>::max();
  for_each_within(scene, col, row, 1.5, [&](int r, int c) {
    if (r != row || c != col) {
      brightest = std::max(brightest, static_cast<double>(scene.pixels(r, c)));
    }
  });
  return brightest;
}

/// Replaces hot pixels that sit on spots. clean_spot_picture() cannot find them, because it does
/// not know where spots are; here they show because they fall to their neighbours much more steeply
/// than the candidates do. Returns true if any was replaced.
bool remove_hot_pixels_in_spots(SpotScene& scene, const std::vector<Spot>& candidates) {
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
  const double minimum = kSteeper * quantile(std::move(spreads), 0.5);
  const Image<float> before = scene.pixels;
  bool any = false;
  for (int r = 0; r < before.rows(); ++r) {
    for (int c = 0; c < before.cols(); ++c) {
      const auto here = static_cast<double>(before(r, c));
      if (here < 8.0 * scene.pixel_noise) continue;
      const double next = brightest_neighbour(scene, r, c);
      if (next > minimum * here) continue;
      scene.pixels(r, c) = static_cast<float>(next);
      if (here - next > scene.matters) scene.hot(r, c) = 1;
      any = true;
    }
  }
  return any;
}

}  // namespace

double SpotScene::smooth_at(double x, double y) const {
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

bool SpotScene::on_frame(double x, double y) const {
  return x >= -0.5 && y >= -0.5 && x < smooth.cols() - 0.5 && y < smooth.rows() - 0.5;
}

SpotScene make_spot_scene(const SpotPicture& picture, double pitch_px) {
  SpotScene scene;
  scene.pitch = pitch_px;
  scene.pixels = picture.pixels_adu;
  scene.hot = picture.hot;
  scene.matters = picture.matters_adu;
  for (float& v : scene.pixels) v -= static_cast<float>(picture.background_adu);
  const double smooth_px = smoothing_px(pitch_px);
  scene.smooth = smooth_gaussian(scene.pixels, smooth_px);
  scene.pixel_noise = picture.noise_adu;
  scene.noise = picture.noise_adu / (2.0 * std::sqrt(std::numbers::pi) * smooth_px);
  return scene;
}

std::vector<Spot> find_candidates(SpotScene& scene) {
  std::vector<Spot> candidates = find_maxima(scene);
  if (remove_hot_pixels_in_spots(scene, candidates)) {
    scene.smooth = smooth_gaussian(scene.pixels, smoothing_px(scene.pitch));
    candidates = find_maxima(scene);
  }
  return candidates;
}

std::optional<Spot> find_spot_at(const SpotScene& scene, double x, double y) {
  int best_row = -1;
  int best_col = -1;
  float best = -std::numeric_limits<float>::max();
  for_each_within(scene, x, y, std::max(kSpotReach * scene.pitch, 1.5), [&](int r, int c) {
    if (scene.smooth(r, c) <= best) return;
    best = scene.smooth(r, c);
    best_row = r;
    best_col = c;
  });
  if (best_row < 0 || !is_brightest_around(scene, best_row, best_col)) return std::nullopt;
  const double height = prominence(scene, best_row, best_col);
  if (height > kSpotNoises * scene.noise) return measure_spot(scene, best_row, best_col, height);
  return std::nullopt;
}

}  // namespace curlew
