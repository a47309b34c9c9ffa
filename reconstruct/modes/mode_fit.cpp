#include "reconstruct/modes/mode_fit.h"

#include <array>
#include <cmath>
#include <limits>
#include <numbers>

namespace curlew {
namespace {

/// The nodes and weights of Gauss and Legendre on (0, 1). Exact up to degree 2·kNodes − 1, above
/// that of every mode there can be.
constexpr int kNodes = 24;
constexpr int kLargestNoll = 496;

struct Quadrature {
  std::array<double, kNodes> node{};
  std::array<double, kNodes> weight{};
};

Quadrature gauss_legendre() {
  Quadrature q;
  for (int i = 0; i < kNodes; ++i) {
    double x = std::cos(std::numbers::pi * (i + 0.75) / (kNodes + 0.5));
    double slope = 0.0;
    for (int step = 0; step < 20; ++step) {  // Newton's
      double p = 1.0, before = 0.0;
      for (int n = 1; n <= kNodes; ++n) {
        const double older = before;
        before = p;
        p = ((2.0 * n - 1.0) * x * before - (n - 1.0) * older) / n;
      }
      slope = kNodes * (x * p - before) / (x * x - 1.0);
      x -= p / slope;
    }
    const auto k = static_cast<std::size_t>(i);
    q.node[k] = 0.5 * (1.0 - x);
    q.weight[k] = 1.0 / ((1.0 - x * x) * slope * slope);
  }
  return q;
}

/// Returns the last Noll index of the radial orders that are whole within `wanted` and need no more
/// than half as many modes as there are lenslets.
int last_index(int wanted, std::size_t lenslets) {
  const int limit = std::min(wanted, kLargestNoll);
  int last = 1;
  for (int order = 1;; ++order) {
    const int next = (order + 1) * (order + 2) / 2;
    if (next > limit || 2 * static_cast<std::size_t>(next - 1) > lenslets) return last;
    last = next;
  }
}

/// Modes that the lenslets do not tell apart leave a pivot that is nothing but rounding.
bool tells_apart(const Eigen::LLT<Eigen::MatrixXd>& factor) {
  constexpr double kSmallestPivot = 1e-5;
  const auto pivots = factor.matrixLLT().diagonal();
  return pivots.minCoeff() > kSmallestPivot * pivots.maxCoeff();
}

}  // namespace

ModePlan::ModePlan(const Image<std::uint8_t>& valid, int last_noll)
    : pupil_(find_zernike_pupil(valid)) {
  for (std::size_t k = 0; k < valid.size(); ++k)
    if (valid[k] != 0) lenslets_.push_back(k);
  const int last = last_index(last_noll, lenslets_.size());
  for (int noll = 2; noll <= last; ++noll) zernikes_.emplace_back(noll);
  find_slopes(valid);
  orthonormalise();
}

/// Returns all modes of the disc at a place in lenslet units.
Eigen::VectorXd ModePlan::values(double x, double y) const {
  Eigen::VectorXd all(modes());
  for (int i = 0; i < modes(); ++i)
    all[i] = zernike(i)((x - pupil_.x) / pupil_.radius, (y - pupil_.y) / pupil_.radius);
  return all;
}

// By Gauss' theorem the mean gradient over a square is the difference of the means along its sides.
void ModePlan::find_slopes(const Image<std::uint8_t>& valid) {
  const Quadrature q = gauss_legendre();
  slopes_x_ = slopes_y_ =
      Eigen::MatrixXd::Zero(modes(), static_cast<Eigen::Index>(lenslets_.size()));
  for (std::size_t i = 0; i < lenslets_.size(); ++i) {
    const auto cols = static_cast<std::size_t>(valid.cols());
    const std::size_t row_index = lenslets_[i] / cols;
    const auto row = static_cast<double>(row_index);
    const auto col = static_cast<double>(lenslets_[i] % cols);
    const auto column = static_cast<Eigen::Index>(i);
    for (std::size_t n = 0; n < kNodes; ++n) {
      const double along = q.node[n] - 0.5;
      slopes_x_.col(column) +=
          q.weight[n] * (values(col + 0.5, row + along) - values(col - 0.5, row + along));
      slopes_y_.col(column) +=
          q.weight[n] * (values(col + along, row + 0.5) - values(col + along, row - 0.5));
    }
  }
  normal_ = slopes_x_ * slopes_x_.transpose() + slopes_y_ * slopes_y_.transpose();
}

// With G = L·Lᵀ, the mean products of the disc's modes over the annulus, L⁻¹ makes orthonormal
// modes of them, one after the other in Noll's order; and with φ = aᵀ·Z the new coefficients are
// Lᵀ·a. The piston takes part, so that no mode has a mean over the annulus.
void ModePlan::orthonormalise() {
  const int n = modes() + 1;
  Eigen::MatrixXd products = Eigen::MatrixXd::Zero(n, n);
  const Quadrature q = gauss_legendre();
  constexpr int kAngles = 128;
  const double inner = pupil_.obscuration * pupil_.obscuration;
  for (std::size_t i = 0; i < kNodes; ++i) {
    // Nodes in ρ², by which the area grows evenly, and in which the products are polynomials.
    const double rho = std::sqrt(inner + (1.0 - inner) * q.node[i]) * pupil_.radius;
    for (int angle = 0; angle < kAngles; ++angle) {
      const double theta = 2.0 * std::numbers::pi * angle / kAngles;
      Eigen::VectorXd all(n);
      all << 1.0, values(pupil_.x + rho * std::cos(theta), pupil_.y + rho * std::sin(theta));
      products += q.weight[i] / kAngles * all * all.transpose();
    }
  }
  const Eigen::MatrixXd factor = products.llt().matrixL();
  annular_from_disc_ = factor.bottomRightCorner(modes(), modes()).transpose();
}

void ModePlan::put_slopes(int i, SlopeField& slopes) const {
  for (std::size_t at = 0; at < lenslets_.size(); ++at) {
    slopes.x[lenslets_[at]] = static_cast<float>(slopes_x_(i, static_cast<Eigen::Index>(at)));
    slopes.y[lenslets_[at]] = static_cast<float>(slopes_y_(i, static_cast<Eigen::Index>(at)));
  }
}

ModeResponse ModePlan::response() const {
  const Eigen::LLT<Eigen::MatrixXd> factor(normal_);
  if (modes() == 0 || factor.info() != Eigen::Success || !tells_apart(factor)) return {};
  return {lenslets_, annular_from_disc_ * factor.solve(slopes_x_),
          annular_from_disc_ * factor.solve(slopes_y_)};
}

ModeFit::ModeFit(const ModePlan& plan)
    : plan_(plan),
      factor_of_all_(plan.normal_),
      factor_(plan.normal_.rows()),
      normal_(plan.normal_),
      right_(plan.modes()),
      coefficients_(plan.modes()),
      response_of_all_(plan.response()),
      inverse_(plan.modes(), plan.modes()),
      solved_(plan.modes(), plan.modes()),
      column_x_(plan.modes()),
      column_y_(plan.modes()),
      errors_(plan.modes()) {}

bool ModeFit::fit(const SlopeField& slopes) noexcept {
  right_.setZero();
  bool all = true;
  for (std::size_t i = 0; i < plan_.lenslets_.size(); ++i) {
    const std::size_t k = plan_.lenslets_[i];
    const auto column = static_cast<Eigen::Index>(i);
    if (slopes.valid[k] != 0) {
      right_.noalias() += static_cast<double>(slopes.x[k]) * plan_.slopes_x_.col(column);
      right_.noalias() += static_cast<double>(slopes.y[k]) * plan_.slopes_y_.col(column);
      continue;
    }
    if (all) normal_ = plan_.normal_;
    all = false;
    normal_.noalias() -= plan_.slopes_x_.col(column) * plan_.slopes_x_.col(column).transpose();
    normal_.noalias() -= plan_.slopes_y_.col(column) * plan_.slopes_y_.col(column).transpose();
  }
  if (!all) factor_.compute(normal_);
  all_ = all;
  fitted_ = false;
  const Eigen::LLT<Eigen::MatrixXd>& factor = all ? factor_of_all_ : factor_;
  if (plan_.modes() == 0 || factor.info() != Eigen::Success || !tells_apart(factor)) {
    coefficients_.setConstant(std::numeric_limits<double>::quiet_NaN());
    return false;
  }
  factor.solveInPlace(right_);
  coefficients_.noalias() = plan_.annular_from_disc_ * right_;
  fitted_ = true;
  return true;
}

// With c = R·s the variance of a coefficient is R·C·Rᵀ, where C is the covariance of each lenslet's
// two slopes.
const Eigen::VectorXd& ModeFit::find_errors(const SlopeField& slopes) noexcept {
  if (!fitted_) {
    errors_.setConstant(std::numeric_limits<double>::quiet_NaN());
    return errors_;
  }
  if (!all_) {
    solved_.setIdentity();
    factor_.solveInPlace(solved_);
    inverse_.noalias() = plan_.annular_from_disc_ * solved_;
  }
  errors_.setZero();
  for (std::size_t i = 0; i < plan_.lenslets_.size(); ++i) {
    const std::size_t k = plan_.lenslets_[i];
    if (slopes.valid[k] == 0) continue;
    const auto column = static_cast<Eigen::Index>(i);
    if (all_) {
      column_x_ = response_of_all_.x.col(column);
      column_y_ = response_of_all_.y.col(column);
    } else {
      column_x_.noalias() = inverse_ * plan_.slopes_x_.col(column);
      column_y_.noalias() = inverse_ * plan_.slopes_y_.col(column);
    }
    errors_.array() +=
        static_cast<double>(slopes.variance_x[k]) * column_x_.array().square() +
        static_cast<double>(slopes.variance_y[k]) * column_y_.array().square() +
        2.0 * static_cast<double>(slopes.covariance_xy[k]) * column_x_.array() * column_y_.array();
  }
  errors_ = errors_.cwiseMax(0.0).cwiseSqrt();
  return errors_;
}

}  // namespace curlew
