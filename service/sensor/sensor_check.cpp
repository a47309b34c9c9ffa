#include "service/sensor/sensor_check.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "centroiding/pixel_response.h"
#include "core/error.h"

namespace curlew {
namespace {

constexpr double kMostAdu = 1e12;  // beyond what any converter counts

[[noreturn]] void refuse(const std::string& path, const std::string& what) {
  throw Failure(path + ": " + what + ", calibrate again");
}

void check_lenslet(const std::string& path, const Sensor& sensor, std::size_t k) {
  const Window& w = sensor.window[k];
  if (w.w < 1 || w.h < 1 || w.x0 < 0 || w.y0 < 0 || w.x0 > sensor.frame_cols - w.w ||
      w.y0 > sensor.frame_rows - w.h)
    refuse(path, "the window of lenslet " + std::to_string(k) + " lies outside the detector");
  const auto within = [](float reference, int start, int length) {
    return reference >= static_cast<float>(start) - 1.0F &&
           reference <= static_cast<float>(start + length);
  };
  const auto is_gain = [](float gain) { return gain >= 0.01F && gain <= 100.0F; };
  if (!within(sensor.ref_x_px[k], w.x0, w.w) || !within(sensor.ref_y_px[k], w.y0, w.h) ||
      !is_gain(sensor.gain_x[k]) || !is_gain(sensor.gain_y[k]))
    refuse(path,
           "lenslet " + std::to_string(k) + " is valid but its reference or gain makes no sense");
  constexpr float kMostBent = 100.0F;
  for (const auto* bend : {&sensor.bend2_x, &sensor.bend2_y, &sensor.bend3_x, &sensor.bend3_y})
    if (!bend->empty() && !(std::abs((*bend)[k]) <= kMostBent))
      refuse(path, "lenslet " + std::to_string(k) + " is valid but its BEND makes no sense");
  if (!(std::abs(static_cast<double>(sensor.flux_adu[k])) <= kMostAdu))
    refuse(path, "lenslet " + std::to_string(k) + " is valid but its FLUX makes no sense");
}

/// Sums up where the references of valid lenslets are, for a fit of reference = (1, col, row)·b.
struct GridSums {
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Matrix<double, 3, 2> right = Eigen::Matrix<double, 3, 2>::Zero();
};

// What is not known is NaN, and refused by whoever needs it.
void check_optics(const std::string& path, const Sensor& sensor) {
  const double slope_rad_per_px = std::abs(sensor.optics.slope_rad_per_px());
  if (slope_rad_per_px < 1e-4 || slope_rad_per_px > 1e4)
    refuse(path, "the keys PITCH_M, FOCAL_M, PIXEL_M, WAVELEN and MAGNIF make no sensor");
}

// The grid is that of the reference spots: the spots alone give the same P, and none is further
// than a pitch from its place.
void check_grid(const std::string& path, const Sensor& sensor) {
  constexpr double kMostOfPitch = 0.05;
  const LensletGrid& grid = sensor.grid;
  if (!(grid.pitch_px() > 1e-3) || !(grid.pitch_px() < 1e6))
    refuse(path, "the keys P11 to P22 make no grid");
  if ((grid.determinant() < 0.0) != sensor.optics.mirrored)
    refuse(path, "the keys P11 to P22 and PARITY contradict each other");
  GridSums sums;
  for (int row = 0; row < grid.rows; ++row) {
    for (int col = 0; col < grid.cols; ++col) {
      if (sensor.valid(row, col) == 0) continue;
      const Eigen::RowVector2d reference(sensor.ref_x_px(row, col), sensor.ref_y_px(row, col));
      const auto place = grid.pixel_from_lenslet(col, row);
      if (!(std::hypot(reference.x() - place[0], reference.y() - place[1]) < grid.pitch_px()))
        refuse(path, "the reference spot of lenslet " + std::to_string(row * grid.cols + col) +
                         " is not where the keys ORIGINX to P22 have it");
      const Eigen::Vector3d at(1.0, col, row);
      sums.normal += at * at.transpose();
      sums.right += at * reference;
    }
  }
  const Eigen::FullPivLU<Eigen::Matrix3d> solver(sums.normal);
  if (!solver.isInvertible()) return;  // a single row or column of lenslets
  const Eigen::Matrix<double, 3, 2> fit = solver.solve(sums.right);
  const double off = std::max({std::abs(fit(1, 0) - grid.p11), std::abs(fit(2, 0) - grid.p12),
                               std::abs(fit(1, 1) - grid.p21), std::abs(fit(2, 1) - grid.p22)});
  if (!(off <= kMostOfPitch * grid.pitch_px()))
    refuse(path, "REFX and REFY make another grid than the keys P11 to P22");
}

void check_maps(const std::string& path, Sensor& sensor) {
  if (!(std::abs(sensor.background_adu) <= kMostAdu))
    refuse(path, "the key BACKGRND makes no sense");
  if (!sensor.dark_adu.empty()) {
    Image<std::uint8_t> bad(sensor.frame_rows, sensor.frame_cols);
    for (std::size_t i = 0; i < bad.size(); ++i)
      bad[i] = std::abs(static_cast<double>(sensor.dark_adu[i])) <= kMostAdu ? 0 : 1;
    add_bad_pixels(sensor, bad);
  }
  if (sensor.flat.empty()) return;
  const float median = median_response(sensor.flat);
  if (!(median > 0.1F && median < 10.0F)) refuse(path, "FLAT is not relative to its mean");
  add_bad_pixels(sensor, find_unresponsive_pixels(sensor.flat));
}

}  // namespace

void check_sensor(const std::string& path, Sensor& sensor) {
  for (std::size_t k = 0; k < sensor.valid.size(); ++k)
    if (sensor.valid[k] != 0) check_lenslet(path, sensor, k);
  check_optics(path, sensor);
  check_grid(path, sensor);
  check_maps(path, sensor);
}

}  // namespace curlew
