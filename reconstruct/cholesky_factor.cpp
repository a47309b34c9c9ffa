// Highway compiles this file once for every instruction set and chooses one at run time.
#include "reconstruct/cholesky_factor.h"

#include <Eigen/OrderingMethods>
#include <Eigen/SparseCholesky>

#include "core/error.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "reconstruct/cholesky_factor.cpp"
#include "hwy/foreach_target.h"
// Highway needs foreach_target.h before the header below.

#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace curlew::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

constexpr int kLanes = CholeskyFactor::kLanes;

/// Solves with L, for whose arrays see the members of CholeskyFactor.
void solve(int size, const std::int32_t* start, const std::int32_t* row, const float* values,
           const float* inverse_diagonal, float* b) {
  const hn::CappedTag<float, kLanes> d;
  const auto step = static_cast<int>(hn::Lanes(d));
  for (int lane = 0; lane < kLanes; lane += step) {
    float* const of_lanes = b + lane;
    for (int j = 0; j < size; ++j) {
      float* const at = of_lanes + std::ptrdiff_t{j} * kLanes;
      const auto y = hn::Mul(hn::Load(d, at), hn::Set(d, inverse_diagonal[j]));
      hn::Store(y, d, at);
      for (std::int32_t i = start[j]; i < start[j + 1]; ++i) {
        float* const to = of_lanes + std::ptrdiff_t{row[i]} * kLanes;
        hn::Store(hn::NegMulAdd(hn::Set(d, values[i]), y, hn::Load(d, to)), d, to);
      }
    }
  }
}

void multiply(const float* a, const float* b, int n, float* products, std::ptrdiff_t stride) {
  constexpr int kRows = 8;  // as many sums as fit into registers
  const hn::CappedTag<float, kLanes> d;
  using V = hn::Vec<decltype(d)>;
  const auto step = static_cast<int>(hn::Lanes(d));
  for (int first = 0; first < kLanes; first += kRows) {
    for (int lane = 0; lane < kLanes; lane += step) {
      V s0 = hn::Zero(d), s1 = s0, s2 = s0, s3 = s0, s4 = s0, s5 = s0, s6 = s0, s7 = s0;
      const float* from = a + first;
      const float* with = b + lane;
      for (int k = 0; k < n; ++k, from += kLanes, with += kLanes) {
        const V v = hn::Load(d, with);
        s0 = hn::MulAdd(hn::Set(d, from[0]), v, s0);
        s1 = hn::MulAdd(hn::Set(d, from[1]), v, s1);
        s2 = hn::MulAdd(hn::Set(d, from[2]), v, s2);
        s3 = hn::MulAdd(hn::Set(d, from[3]), v, s3);
        s4 = hn::MulAdd(hn::Set(d, from[4]), v, s4);
        s5 = hn::MulAdd(hn::Set(d, from[5]), v, s5);
        s6 = hn::MulAdd(hn::Set(d, from[6]), v, s6);
        s7 = hn::MulAdd(hn::Set(d, from[7]), v, s7);
      }
      float* const to = products + first * stride + lane;
      hn::StoreU(s0, d, to);
      hn::StoreU(s1, d, to + stride);
      hn::StoreU(s2, d, to + 2 * stride);
      hn::StoreU(s3, d, to + 3 * stride);
      hn::StoreU(s4, d, to + 4 * stride);
      hn::StoreU(s5, d, to + 5 * stride);
      hn::StoreU(s6, d, to + 6 * stride);
      hn::StoreU(s7, d, to + 7 * stride);
    }
  }
}

}  // namespace
}  // namespace curlew::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace curlew {
namespace {

HWY_EXPORT(solve);
HWY_EXPORT(multiply);

}  // namespace

CholeskyFactor::CholeskyFactor(const Eigen::SparseMatrix<double>& a) {
  const auto n = static_cast<std::size_t>(a.rows());
  position_.resize(n);
  column_start_.assign(1, 0);
  if (n == 0) return;
  const Eigen::SimplicialLLT<Eigen::SparseMatrix<double>, Eigen::Lower, Eigen::AMDOrdering<int>>
      llt(a);
  if (llt.info() != Eigen::Success)
    throw Failure("reconstruct: the lattice's Laplacian is not positive definite");
  for (std::size_t i = 0; i < n; ++i)
    position_[i] = llt.permutationP().indices()[static_cast<Eigen::Index>(i)];
  const Eigen::SparseMatrix<double> l = llt.matrixL();
  for (int column = 0; column < l.outerSize(); ++column) {
    for (Eigen::SparseMatrix<double>::InnerIterator it(l, column); it; ++it) {
      if (it.row() == column) {
        inverse_diagonal_.push_back(static_cast<float>(1.0 / it.value()));
      } else {
        row_.push_back(static_cast<std::int32_t>(it.row()));
        values_.push_back(static_cast<float>(it.value()));
      }
    }
    column_start_.push_back(static_cast<std::int32_t>(row_.size()));
  }
}

void CholeskyFactor::solve_lower_in_place(float* b) const noexcept {
  HWY_DYNAMIC_DISPATCH(solve)
  (size(), column_start_.data(), row_.data(), values_.data(), inverse_diagonal_.data(), b);
}

void multiply_lanes(const float* a, const float* b, int n, float* products,
                    std::ptrdiff_t stride) noexcept {
  HWY_DYNAMIC_DISPATCH(multiply)(a, b, n, products, stride);
}

}  // namespace curlew
#endif
