#include "acquisition/simulator/turbulent_path.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <numbers>
#include <sstream>

#include "core/error.h"

namespace curlew {
namespace {

constexpr double kSpacing = 0.008;   // √(λL): l0 = .02 √(λL) is 2.5 points long
constexpr double kPlaneWidth = 4.0;  // √(λL)
constexpr double kBeamWidth = 6.0;   // 1/e² radii where the beam arrives
constexpr int kMargin = 4;           // lenslets
constexpr int kLargestGrid = 8192;
constexpr double kRounding = 1.0 + 1e-9;

void check_path(const TurbulentPath& p) {
  require(std::isfinite(p.rytov_variance) && p.rytov_variance >= 0.0,
          "the Rytov variance must be 0 or more");
  require(std::isfinite(p.lenslet) && p.lenslet > 0.0,
          "the lenslet size in sqrt(lambda L) must be a number above 0");
  require(p.inner_scale >= 0.0 && p.outer_scale > p.inner_scale,
          "the inner scale must be 0 or more and below the outer scale");
  require(p.screens >= 1 && p.screens <= 1000, "phase screens must number from 1 to 1000");
  require(std::isfinite(p.waist) && p.waist >= 0.0,
          "the beam's waist must be a number above 0, or 0 for a plane wave");
  require(p.waist == 0.0 || std::isfinite(p.outer_scale),
          "a Gaussian beam needs a finite outer scale");
  require(static_cast<int>(p.wind.size()) <= p.screens,
          "there are more winds than phase screens; give as many at most");
  require(std::all_of(p.wind.begin(), p.wind.end(),
                      [](const Wind& w) { return std::isfinite(w.x) && std::isfinite(w.y); }),
          "a wind is not a finite number of pitches a frame");
  require(p.grid >= 0 && p.grid <= kLargestGrid && p.grid % 2 == 0,
          "the propagation grid must have an even number of points a side, 8192 at most");
  require(p.grid_samples >= 0 && p.grid_samples <= 256,
          "grid points per lenslet must number from 1 to 256, or be 0 to be chosen");
}

// Returns the next 2^m or 3·2^m, which transform fast.
int round_up_to_fast(double minimum) {
  for (int power = 16;; power *= 2) {
    if (power * kRounding >= minimum) return power;
    const int between = power / 2 * 3;
    if (between * kRounding >= minimum) return between;
  }
}

// Returns the 1/e² radius where the beam arrives, √(λL).
double arriving_radius(double waist) {
  return waist * std::hypot(1.0, 1.0 / (std::numbers::pi * waist * waist));
}

}  // namespace

double rytov_variance(double cn2, double wavelength_m, double path_m) {
  const double k = 2.0 * std::numbers::pi / wavelength_m;
  return 1.23 * cn2 * std::pow(k, 7.0 / 6.0) * std::pow(path_m, 11.0 / 6.0);
}

TurbulentPath chen2007_path() {
  constexpr double kPaperWavelengthM = 633e-9;
  constexpr double kPathM = 100e3;
  const double fresnel_m = std::sqrt(kPaperWavelengthM * kPathM);
  TurbulentPath path;
  path.rytov_variance = rytov_variance(4e-18, kPaperWavelengthM, kPathM);
  path.lenslet = 0.020 / fresnel_m;
  path.outer_scale = 100.0 / fresnel_m;
  path.inner_scale = 0.005 / fresnel_m;
  path.screens = 10;
  path.waist = 0.3 / fresnel_m;
  path.grid = 1024;
  path.grid_samples = 10;
  return path;
}

// In these units λ is 1/L, so k² Cn² L = (2π)^(5/6)/1.23 · variance.
double fried_parameter(const TurbulentPath& path) {
  const double k2_cn2_l = std::pow(2.0 * std::numbers::pi, 5.0 / 6.0) / 1.23 * path.rytov_variance;
  return std::pow(0.423 * k2_cn2_l, -3.0 / 5.0);
}

Wind wind_at_screen(const TurbulentPath& path, int screen) {
  if (path.wind.empty()) return {};
  const double last = static_cast<double>(path.wind.size()) - 1.0;
  const double at = path.screens > 1 ? last * screen / (path.screens - 1.0) : 0.0;
  const auto below = static_cast<std::size_t>(at * kRounding);
  const Wind& a = path.wind[std::min(below, path.wind.size() - 1)];
  const Wind& b = path.wind[std::min(below + 1, path.wind.size() - 1)];
  const double part = std::max(0.0, at - static_cast<double>(below));
  return {a.x + part * (b.x - a.x), a.y + part * (b.y - a.y)};
}

PropagationGrid choose_grid(const TurbulentPath& path, int rows, int cols, int min_samples) {
  check_path(path);
  PropagationGrid grid;
  grid.samples_per_lenslet =
      path.grid_samples > 0
          ? path.grid_samples
          : std::max(2, static_cast<int>(std::ceil(path.lenslet / kSpacing / kRounding)));
  grid.spacing = path.lenslet / grid.samples_per_lenslet;
  grid.finer = std::max(1, (min_samples + grid.samples_per_lenslet - 1) / grid.samples_per_lenslet);

  const int array = std::max(rows, cols) * grid.samples_per_lenslet;
  grid.points = path.grid;
  if (grid.points == 0) {
    const double width = path.waist > 0.0 ? kBeamWidth * arriving_radius(path.waist) : kPlaneWidth;
    const double with_margin = array + 2.0 * kMargin * grid.samples_per_lenslet;
    const double minimum = std::max(width / grid.spacing, with_margin);
    if (minimum > kLargestGrid) {
      throw UsageError(
          "the propagation grid would have more than 8192 points a side; take larger or fewer "
          "lenslets, or fewer grid points a lenslet");
    }
    grid.points = round_up_to_fast(minimum);
  }
  if (grid.points < array) {
    std::ostringstream message;
    message << "a propagation grid of " << grid.points << " points a side is smaller than the array"
            << " of " << array << "; raise the grid or lower the grid points a lenslet";
    throw UsageError(message.str());
  }
  grid.margin = std::min(kMargin, (grid.points - array) / (2 * grid.samples_per_lenslet));

  // Memory is taken by the field, the screens, scratch, the spectrum, and the start of a beam; then
  // by the delivered field and the two halves of its making.
  const auto n = static_cast<std::size_t>(grid.points);
  const int lenslets = std::max(rows, cols) + 2 * grid.margin;
  const auto fine = static_cast<std::size_t>(lenslets) *
                    static_cast<std::size_t>(grid.samples_per_lenslet * grid.finer);
  const std::size_t images = path.waist > 0.0 ? 4 : 3;
  grid.memory_bytes =
      (images * n * n + n * n / 8 + 2 * n * fine + fine * fine) * sizeof(std::complex<float>);
  return grid;
}

}  // namespace curlew
