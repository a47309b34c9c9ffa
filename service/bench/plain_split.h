// Eigen's sparse Cholesky factor solves the least-squares split here, as one would write it without
// knowing anything special about the lattice. split_slopes() is held against it, and in double it
// checks the answers.
#pragma once

#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>
#include <cstdint>
#include <vector>

#include "core/as_size.h"
#include "core/image.h"
#include "core/slope_field.h"

namespace curlew {

/// Finds the φ on lenslet corners whose Γφ is nearest to the measured slopes, in Fried's geometry
/// as in reconstruct/split.h. Scalar is float or double, and everything but the slopes that are
/// given is of this type.
template <typename Scalar>
class PlainSplit {
 public:
  /// valid is [rows, cols], and non-zero where a lenslet is lit. The order of elimination is chosen
  /// here, once for all frames.
  explicit PlainSplit(const Image<std::uint8_t>& valid);

  /// Makes the normal matrix of the frame's valid lenslets, and its factor. A lenslet's weight is
  /// 1, or 2/(σx² + σy²) if `weighted`. One corner of every connected part is pinned to 0. Throws
  /// Failure if rounding makes the matrix indefinite.
  void factorise(const SlopeField& slopes, bool weighted);

  /// Finds φ by the last factor, which must be of a frame with the same valid lenslets and weights,
  /// and then the curl-free slopes. The residual is solved for again `refinements` times.
  void solve(const SlopeField& slopes, int refinements = 0);

  /// These are [rows, cols] in rad per pitch, and 0 where a lenslet is not valid.
  const Image<Scalar>& curl_free_x() const { return curl_free_x_; }
  const Image<Scalar>& curl_free_y() const { return curl_free_y_; }

 private:
  using Matrix = Eigen::SparseMatrix<Scalar>;
  using Vector = Eigen::Matrix<Scalar, Eigen::Dynamic, 1>;

  /// A diagonal of a lenslet from one corner to another. The indices say where the matrix holds it.
  struct Edge {
    int from, to;
    int lenslet;
    bool rising;  ///< it carries s_y − s_x and not s_x + s_y
    int from_diagonal, to_diagonal;
    int off_diagonal;
  };

  void number_corners(const Image<std::uint8_t>& valid);
  void find_values();
  void find_parts();
  Scalar weight(const Edge& edge) const { return weight_[as_size(edge.lenslet)]; }

  std::vector<Edge> edges_;
  Matrix matrix_;  // lower triangle
  Eigen::SimplicialLLT<Matrix, Eigen::Lower> factor_;
  std::vector<Scalar> weight_;  // [rows·cols]
  std::vector<int> part_;  // [corners] another corner of the same part; the pinned corner itself
  Vector right_side_;
  Vector phi_;
  Vector correction_;
  Image<Scalar> curl_free_x_;
  Image<Scalar> curl_free_y_;
};

extern template class PlainSplit<float>;
extern template class PlainSplit<double>;

}  // namespace curlew
