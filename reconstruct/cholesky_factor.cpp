#include "reconstruct/cholesky_factor.h"

#include <Eigen/OrderingMethods>
#include <Eigen/SparseCholesky>

#include "core/error.h"

namespace curlew {

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
  for (std::int32_t j = 0; j < size(); ++j) eliminate(j, b);
}

}  // namespace curlew
