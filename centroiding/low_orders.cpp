#include "centroiding/low_orders.h"

#include <Eigen/Cholesky>
#include <cstddef>

namespace curlew {
namespace {

constexpr int kForQuadratic = 40;
constexpr int kForLinear = 12;
// This much of each term's weight is added, so that spots in one row still have a fit.
constexpr double kRidge = 1e-6;

template <int N>
LowOrders solve_for(const Eigen::Matrix<double, LowOrders::kTerms, LowOrders::kTerms>& normal,
                    const Eigen::Matrix<double, LowOrders::kTerms, 1>& x,
                    const Eigen::Matrix<double, LowOrders::kTerms, 1>& y, int n) noexcept {
  Eigen::Matrix<double, N, N> a = normal.template topLeftCorner<N, N>();
  a.diagonal().array() += kRidge * n;
  const Eigen::LDLT<Eigen::Matrix<double, N, N>> factor(a);
  const Eigen::Matrix<double, N, 1> cx = factor.solve(x.template head<N>());
  const Eigen::Matrix<double, N, 1> cy = factor.solve(y.template head<N>());
  LowOrders model;
  for (int i = 0; i < N; ++i) {
    model.x[static_cast<std::size_t>(i)] = static_cast<float>(cx[i]);
    model.y[static_cast<std::size_t>(i)] = static_cast<float>(cy[i]);
  }
  return model;
}

}  // namespace

LowOrders& LowOrders::operator+=(const LowOrders& other) noexcept {
  for (std::size_t i = 0; i < x.size(); ++i) {
    x[i] += other.x[i];
    y[i] += other.y[i];
  }
  return *this;
}

void LowOrdersFit::add(float u, float v, float x, float y) noexcept {
  const auto a = static_cast<double>(u), b = static_cast<double>(v);
  Terms terms;
  terms << 1.0, a, b, a * a, a * b, b * b;
  for (int i = 0; i < LowOrders::kTerms; ++i)  // The lower triangle is all that is read.
    for (int j = 0; j <= i; ++j) normal_(i, j) += terms[i] * terms[j];
  x_ += static_cast<double>(x) * terms;
  y_ += static_cast<double>(y) * terms;
  ++n_;
}

LowOrders LowOrdersFit::solve() const noexcept {
  if (n_ >= kForQuadratic) return solve_for<LowOrders::kTerms>(normal_, x_, y_, n_);
  if (n_ >= kForLinear) return solve_for<3>(normal_, x_, y_, n_);
  if (n_ > 0) return solve_for<1>(normal_, x_, y_, n_);
  return {};
}

}  // namespace curlew
