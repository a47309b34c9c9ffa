#include "service/results/wavefront_meter.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "core/as_size.h"

namespace curlew {
namespace {

Image<std::uint8_t> lit_lenslets(const SplitPlan& split) {
  Image<std::uint8_t> lit(split.grid().rows, split.grid().cols);
  for (const std::int32_t k : split.lenslets()) lit[as_size(k)] = 1;
  return lit;
}

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

/// Returns the phase at a lenslet with what its Laplacian says that it has lost.
double sharpened(const Image<float>& phase, const Image<std::uint8_t>& valid, int row, int col) {
  constexpr double kWeakened = 5.0 / 48.0;
  return static_cast<double>(phase(row, col)) -
         kWeakened * (second_difference(phase, valid, row, col, 0, 1) +
                      second_difference(phase, valid, row, col, 1, 0));
}

/// Takes off the mean over each part of the pupil whose phase has a free constant of its own.
void remove_pistons(const Lattice& lattice, const std::vector<std::size_t>& lenslets,
                    Eigen::Ref<Eigen::VectorXd> heights) {
  Eigen::VectorXd sums = Eigen::VectorXd::Zero(lattice.n_phase_groups());
  Eigen::VectorXd counts = sums;
  const auto group_of = [&](std::size_t i) {
    return lattice.phase_group_of(static_cast<int>(lenslets[i]));
  };
  for (std::size_t i = 0; i < lenslets.size(); ++i) {
    sums[group_of(i)] += heights[static_cast<Eigen::Index>(i)];
    counts[group_of(i)] += 1.0;
  }
  for (std::size_t i = 0; i < lenslets.size(); ++i)
    heights[static_cast<Eigen::Index>(i)] -= sums[group_of(i)] / counts[group_of(i)];
}

}  // namespace

ModePlan modes_of(const SplitPlan& split) { return {lit_lenslets(split), kLastNoll}; }

double WavefrontFigures::strehl() const { return std::exp(-rms_rad * rms_rad); }

WavefrontMeter::WavefrontMeter(const SplitPlan& split)
    : modes_(modes_of(split)),
      fit_(modes_),
      lenslets_(split.lenslets().begin(), split.lenslets().end()),
      height_(std::ssize(lenslets_)),
      remaining_(split.grid().rows, split.grid().cols) {
  split_modes(split);
}

void WavefrontMeter::split_modes(const SplitPlan& split) {
  const Image<std::uint8_t> lit = lit_lenslets(split);
  const ZernikePupil& pupil = modes_.pupil();
  SlopeField slopes(lit.rows(), lit.cols());
  slopes.valid = lit;
  std::fill(slopes.variance_x.begin(), slopes.variance_x.end(), 1.0F);
  std::fill(slopes.variance_y.begin(), slopes.variance_y.end(), 1.0F);
  SplitWorkspace workspace(split);
  HodgeSplit of_mode(lit.rows(), lit.cols());
  phase_of_modes_.resize(std::ssize(lenslets_), modes_.modes());
  height_of_modes_.resize(std::ssize(lenslets_), modes_.modes());
  for (int mode = 0; mode < modes_.modes(); ++mode) {
    modes_.put_slopes(mode, slopes);
    split_slopes(split, slopes, workspace, of_mode);
    for (std::size_t i = 0; i < lenslets_.size(); ++i) {
      const auto at = static_cast<Eigen::Index>(i);
      const int row = static_cast<int>(lenslets_[i]) / lit.cols();
      const int col = static_cast<int>(lenslets_[i]) % lit.cols();
      phase_of_modes_(at, mode) = static_cast<double>(of_mode.phase[lenslets_[i]]);
      height_of_modes_(at, mode) =
          modes_.zernike(mode)((col - pupil.x) / pupil.radius, (row - pupil.y) / pupil.radius);
    }
    remove_pistons(split.lattice(), lenslets_, height_of_modes_.col(mode));
  }
}

WavefrontFigures WavefrontMeter::measure(const Image<float>& phase_rad,
                                         const SlopeField& slopes) noexcept {
  constexpr double kUnknownFigure = std::numeric_limits<double>::quiet_NaN();
  const bool fitted = fit_.fit(slopes);
  height_.setZero();
  if (fitted) height_.noalias() = phase_of_modes_ * fit_.disc_coefficients();
  for (std::size_t i = 0; i < lenslets_.size(); ++i)
    remaining_[lenslets_[i]] = static_cast<float>(static_cast<double>(phase_rad[lenslets_[i]]) -
                                                  height_[static_cast<Eigen::Index>(i)]);
  if (fitted) height_.noalias() = height_of_modes_ * fit_.disc_coefficients();
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  const auto for_each = [&](auto&& act) {
    for (std::size_t i = 0; i < lenslets_.size(); ++i) {
      if (slopes.valid[lenslets_[i]] == 0) continue;
      const int row = static_cast<int>(lenslets_[i]) / slopes.valid.cols();
      const int col = static_cast<int>(lenslets_[i]) % slopes.valid.cols();
      act(row, col, height_[static_cast<Eigen::Index>(i)]);
    }
  };
  for_each([&](int row, int col, double& height) {
    height += sharpened(remaining_, slopes.valid, row, col);
    const Eigen::Vector3d place(1.0, col, row);
    normal += place * place.transpose();
    right += height * place;
  });
  const double count = normal(0, 0);
  const Eigen::FullPivLU<Eigen::Matrix3d> solver(normal);
  if (count < 3.0 || !solver.isInvertible()) return {kUnknownFigure, kUnknownFigure};
  const Eigen::Vector3d plane = solver.solve(right);
  double sum = 0.0;
  double low = std::numeric_limits<double>::infinity();
  double high = -low;
  for_each([&](int row, int col, double height) {
    const double residual = height - plane.dot(Eigen::Vector3d(1.0, col, row));
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
