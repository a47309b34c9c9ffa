#include "service/results/wavefront_figures.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace curlew {

namespace {

/// Returns the second difference along the rows or the columns. Where the lenslet has one neighbour
/// only it is that of the neighbour, or lies on the straight line through those of the next two; it
/// is 0 where no three valid lenslets are in a line.
double second_difference(const Image<float>& phase, const Image<std::uint8_t>& valid, int row,
                         int col, int down, int right) {
  const auto is_valid = [&](int steps) {
    const int r = row + steps * down;
    const int c = col + steps * right;
    return r >= 0 && r < valid.rows() && c >= 0 && c < valid.cols() && valid(r, c) != 0;
  };
  const auto at = [&](int steps) {
    return static_cast<double>(phase(row + steps * down, col + steps * right));
  };
  const auto is_known = [&](int middle) {
    return is_valid(middle - 1) && is_valid(middle) && is_valid(middle + 1);
  };
  const auto difference = [&](int middle) {
    return at(middle - 1) - 2.0 * at(middle) + at(middle + 1);
  };
  if (is_known(0)) return difference(0);
  for (const int inwards : {1, -1})
    if (is_known(inwards))
      return is_known(2 * inwards) ? 2.0 * difference(inwards) - difference(2 * inwards)
                                   : difference(inwards);
  return 0.0;
}

}  // namespace

double WavefrontFigures::strehl() const { return std::exp(-rms_rad * rms_rad); }

WavefrontFigures measure_wavefront(const Image<float>& phase_rad,
                                   const Image<std::uint8_t>& valid) {
  constexpr double kUnknownFigure = std::numeric_limits<double>::quiet_NaN();
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  constexpr double kWeakened = 5.0 / 48.0;
  const auto for_each = [&](auto&& act) {
    for (int row = 0; row < valid.rows(); ++row)
      for (int col = 0; col < valid.cols(); ++col) {
        if (valid(row, col) == 0) continue;
        const double laplacian = second_difference(phase_rad, valid, row, col, 0, 1) +
                                 second_difference(phase_rad, valid, row, col, 1, 0);
        act(Eigen::Vector3d(1.0, col, row),
            static_cast<double>(phase_rad(row, col)) - kWeakened * laplacian);
      }
  };
  for_each([&](const Eigen::Vector3d& place, double phase) {
    normal += place * place.transpose();
    right += phase * place;
  });
  const double count = normal(0, 0);
  const Eigen::FullPivLU<Eigen::Matrix3d> solver(normal);
  if (count < 3.0 || !solver.isInvertible()) return {kUnknownFigure, kUnknownFigure};
  const Eigen::Vector3d plane = solver.solve(right);
  double sum = 0.0;
  double low = std::numeric_limits<double>::infinity();
  double high = -low;
  for_each([&](const Eigen::Vector3d& place, double phase) {
    const double residual = phase - plane.dot(place);
    sum += residual * residual;
    low = std::min(low, residual);
    high = std::max(high, residual);
  });
  return {std::sqrt(sum / count), high - low};
}

double nm_of(double rad, double wavelength_m) {
  constexpr double kNmPerM = 1e9;
  return rad / (2.0 * std::numbers::pi) * wavelength_m * kNmPerM;
}

}  // namespace curlew
