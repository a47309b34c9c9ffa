#include "centroiding/calibration/grid_fit.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "centroiding/calibration/spot_picture.h"

namespace curlew {

bool fit_grid(LensletGrid& grid, const IndexedSpots& spots) {
  const auto distance = [&grid](const LensletIndex& at, const Spot& spot) {
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

double rms_distance_px(const LensletGrid& grid, const IndexedSpots& spots) {
  const bool all_cut =
      std::ranges::all_of(spots, [](const auto& entry) { return entry.second.cut; });
  double sum = 0.0;
  int n = 0;
  for (const auto& [at, spot] : spots) {
    if (spot.cut && !all_cut) continue;
    const auto [x, y] = grid.pixel_from_lenslet(at.first, at.second);
    sum += (spot.x - x) * (spot.x - x) + (spot.y - y) * (spot.y - y);
    ++n;
  }
  return n > 0 ? std::sqrt(sum / n) : 0.0;
}

double anisotropy_of(const LensletGrid& grid) {
  const double sum = std::hypot(grid.p11 + grid.p22, grid.p21 - grid.p12);
  const double difference = std::hypot(grid.p11 - grid.p22, grid.p21 + grid.p12);
  const double larger = 0.5 * (sum + difference);
  const double smaller = 0.5 * std::abs(sum - difference);
  return larger / smaller - 1.0;
}

}  // namespace curlew
