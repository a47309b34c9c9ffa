#include "service/bench/field_modes.h"

#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>

#include "acquisition/simulator/propagation.h"
#include "core/error.h"

namespace curlew {
namespace {

/// Returns Legendre polynomials, made orthonormal over the points of an axis: [points, n].
Eigen::MatrixXd orthonormal_polynomials(int points, int n) {
  Eigen::MatrixXd values(points, n);
  for (int i = 0; i < points; ++i) {
    const double x = (2.0 * i + 1.0) / points - 1.0;
    values(i, 0) = 1.0;
    if (n > 1) values(i, 1) = x;
    for (int k = 2; k < n; ++k)
      values(i, k) = ((2 * k - 1) * x * values(i, k - 1) - (k - 1) * values(i, k - 2)) / k;
  }
  const Eigen::HouseholderQR<Eigen::MatrixXd> qr(values);
  return qr.householderQ() * Eigen::MatrixXd::Identity(points, n);
}

}  // namespace

SampledField simulate_true_field(const FieldParameters& parameters, std::uint64_t seed) {
  const SimulatorOptions options = simulator_options(parameters, seed);
  Propagation propagation(*options.turbulence, options.rows, options.cols,
                          min_field_samples(options), options.seed);
  SampledField field;
  propagation.propagate(0, field);
  return field;
}

Eigen::MatrixXcd cut_patch(const SampledField& field, const GradedVortex& vortex, int lenslets) {
  const int n = field.samples_per_lenslet;
  const auto first = [&](double at) {
    return (static_cast<int>(std::floor(at)) + 1 - lenslets / 2 + field.margin_lenslets) * n;
  };
  const int top = first(vortex.y);
  const int left = first(vortex.x);
  const int points = lenslets * n;
  Eigen::MatrixXcd patch(points, points);
  for (int i = 0; i < points; ++i)
    for (int j = 0; j < points; ++j)
      patch(i, j) = std::complex<double>(field.values(top + i, left + j));
  if (vortex.charge < 0) patch = patch.rowwise().reverse().eval();
  return patch;
}

FieldModeEstimator::FieldModeEstimator(int lenslets, int samples, int polynomials)
    : lenslets_(lenslets),
      samples_(samples),
      polynomials_(orthonormal_polynomials(lenslets * samples, polynomials)) {
  const Eigen::Index products = polynomials_.cols() * polynomials_.cols();
  covariance_ = Eigen::MatrixXcd::Zero(products, products);
}

void FieldModeEstimator::add(const SampledField& field, const std::vector<GradedVortex>& vortices,
                             int rows, int cols) {
  const Interior interior{rows, cols};
  const Eigen::Index n = polynomials_.cols();
  std::vector<Eigen::VectorXcd> coefficients;
  for (const GradedVortex& vortex : vortices) {
    if (!vortex.required || !interior.contains(vortex.x, vortex.y)) continue;
    Eigen::MatrixXcd patch = cut_patch(field, vortex, lenslets_);
    patch /= std::sqrt(patch.squaredNorm() / static_cast<double>(patch.size()));
    Eigen::MatrixXcd c = polynomials_.transpose() * patch * polynomials_;
    for (int turn = 0; turn < 4; ++turn) {
      coefficients.emplace_back(Eigen::Map<const Eigen::VectorXcd>(c.data(), n * n));
      // A quarter turn of the patch transposes the coefficients, and changes the sign of the odd
      // polynomials along one axis.
      c = c.transpose().eval();
      for (Eigen::Index odd = 1; odd < n; odd += 2) c.row(odd) *= -1.0;
    }
    ++patches_;
  }
  if (coefficients.empty()) return;
  Eigen::MatrixXcd all(n * n, static_cast<Eigen::Index>(coefficients.size()));
  for (std::size_t i = 0; i < coefficients.size(); ++i)
    all.col(static_cast<Eigen::Index>(i)) = coefficients[i];
  covariance_.selfadjointView<Eigen::Lower>().rankUpdate(all);
}

FieldModes FieldModeEstimator::modes(int count) const {
  if (patches_ == 0) {
    throw Failure(
        "the training fields have no vortex to learn from; raise the Rytov variance or --training");
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXcd> solver(covariance_ / (4.0 * patches_));
  const Eigen::Index n = polynomials_.cols();
  const Eigen::Index kept = std::min<Eigen::Index>(count, n * n);
  const Eigen::VectorXd variances = solver.eigenvalues().reverse().head(kept).cwiseMax(0.0);
  FieldModes result{lenslets_, samples_, 0.0, patches_, {}};
  result.power = variances.sum() / static_cast<double>(polynomials_.rows() * polynomials_.rows());
  result.values.assign(static_cast<std::size_t>(lenslets_) * static_cast<std::size_t>(lenslets_),
                       Eigen::MatrixXcd(samples_ * samples_, kept));
  for (Eigen::Index k = 0; k < kept; ++k) {
    const Eigen::VectorXcd vector = solver.eigenvectors().col(n * n - 1 - k);
    const Eigen::Map<const Eigen::MatrixXcd> c(vector.data(), n, n);
    const Eigen::MatrixXcd mode =
        std::sqrt(0.5 * variances(k)) * (polynomials_ * c * polynomials_.transpose());
    for (int lenslet = 0; lenslet < lenslets_ * lenslets_; ++lenslet) {
      const int top = lenslet / lenslets_ * samples_;
      const int left = lenslet % lenslets_ * samples_;
      for (int point = 0; point < samples_ * samples_; ++point)
        result.values[static_cast<std::size_t>(lenslet)](point, k) =
            mode(top + point / samples_, left + point % samples_);
    }
  }
  return result;
}

}  // namespace curlew
