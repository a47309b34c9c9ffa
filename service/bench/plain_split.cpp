#include "service/bench/plain_split.h"

#include <algorithm>
#include <cstddef>

#include "core/as_size.h"
#include "core/error.h"

namespace curlew {

template <typename Scalar>
PlainSplit<Scalar>::PlainSplit(const Image<std::uint8_t>& valid)
    : weight_(valid.size()),
      curl_free_x_(valid.rows(), valid.cols()),
      curl_free_y_(valid.rows(), valid.cols()) {
  number_corners(valid);
  find_values();
  factor_.analyzePattern(matrix_);
}

/// Numbers the corners of lit lenslets and gives the matrix its size.
template <typename Scalar>
void PlainSplit<Scalar>::number_corners(const Image<std::uint8_t>& valid) {
  const int across = valid.cols() + 1;
  std::vector<int> number(static_cast<std::size_t>((valid.rows() + 1) * across), -1);
  int n = 0;
  const auto corner = [&](int row, int col) {
    int& i = number[as_size(row * across + col)];
    return i >= 0 ? i : i = n++;
  };
  for (int r = 0; r < valid.rows(); ++r) {
    for (int c = 0; c < valid.cols(); ++c) {
      if (valid(r, c) == 0) continue;
      const int lenslet = r * valid.cols() + c;
      edges_.push_back({corner(r, c), corner(r + 1, c + 1), lenslet, false, 0, 0, 0});
      edges_.push_back({corner(r, c + 1), corner(r + 1, c), lenslet, true, 0, 0, 0});
    }
  }
  matrix_.resize(n, n);
  part_.resize(as_size(n));
  right_side_.resize(n);
  phi_.resize(n);
  correction_.resize(n);
}

/// Gives the matrix its pattern, and each edge its places in it.
template <typename Scalar>
void PlainSplit<Scalar>::find_values() {
  std::vector<Eigen::Triplet<Scalar>> entries;
  for (Edge& edge : edges_) {
    entries.emplace_back(edge.from, edge.from, Scalar{1});
    entries.emplace_back(edge.to, edge.to, Scalar{1});
    entries.emplace_back(std::max(edge.from, edge.to), std::min(edge.from, edge.to), Scalar{-1});
  }
  matrix_.setFromTriplets(entries.begin(), entries.end());
  matrix_.makeCompressed();
  const auto place = [&](int row, int col) {
    const int* rows = matrix_.innerIndexPtr();
    const int* begin = rows + matrix_.outerIndexPtr()[col];
    const int* end = rows + matrix_.outerIndexPtr()[col + 1];
    return static_cast<int>(std::lower_bound(begin, end, row) - rows);
  };
  for (Edge& edge : edges_) {
    edge.from_diagonal = place(edge.from, edge.from);
    edge.to_diagonal = place(edge.to, edge.to);
    edge.off_diagonal = place(std::max(edge.from, edge.to), std::min(edge.from, edge.to));
  }
}

/// Joins the corners that valid lenslets connect.
template <typename Scalar>
void PlainSplit<Scalar>::find_parts() {
  for (std::size_t i = 0; i < part_.size(); ++i) part_[i] = static_cast<int>(i);
  const auto root = [&](int i) {
    while (part_[as_size(i)] != i) {
      int& next = part_[as_size(i)];
      next = part_[as_size(next)];
      i = next;
    }
    return i;
  };
  for (const Edge& edge : edges_)
    if (weight(edge) > 0) part_[as_size(root(edge.from))] = root(edge.to);
}

template <typename Scalar>
void PlainSplit<Scalar>::factorise(const SlopeField& slopes, bool weighted) {
  for (std::size_t k = 0; k < weight_.size(); ++k) {
    const Scalar variance = weighted ? Scalar{0.5F} * (static_cast<Scalar>(slopes.variance_x[k]) +
                                                       static_cast<Scalar>(slopes.variance_y[k]))
                                     : Scalar{1};
    weight_[k] = slopes.valid[k] != 0 ? Scalar{1} / variance : Scalar{0};
  }
  find_parts();
  Scalar* values = matrix_.valuePtr();
  std::fill_n(values, matrix_.nonZeros(), Scalar{0});
  const auto pinned = [&](int i) { return part_[as_size(i)] == i; };
  for (const Edge& edge : edges_) {
    const Scalar w = weight(edge);
    // The equation of a pinned corner is φ = 0, at the scale of the others.
    values[edge.from_diagonal] += w;
    values[edge.to_diagonal] += w;
    if (!pinned(edge.from) && !pinned(edge.to)) values[edge.off_diagonal] -= w;
  }
  // A corner whose lenslets have all faded gets the equation φ = 0, too.
  for (const Edge& edge : edges_) {
    if (values[edge.from_diagonal] == Scalar{0}) values[edge.from_diagonal] = Scalar{1};
    if (values[edge.to_diagonal] == Scalar{0}) values[edge.to_diagonal] = Scalar{1};
  }
  factor_.factorize(matrix_);
  if (factor_.info() != Eigen::Success)
    throw Failure("bench: the plain split's normal matrix cannot be factorised");
}

template <typename Scalar>
void PlainSplit<Scalar>::solve(const SlopeField& slopes, int refinements) {
  const auto measured = [&](const Edge& edge) {
    const auto k = as_size(edge.lenslet);
    const auto x = static_cast<Scalar>(slopes.x[k]);
    const auto y = static_cast<Scalar>(slopes.y[k]);
    return edge.rising ? y - x : x + y;
  };
  phi_.setZero();
  for (int pass = 0; pass <= refinements; ++pass) {
    right_side_.setZero();
    for (const Edge& edge : edges_) {
      const Scalar missing = weight(edge) * (measured(edge) - (phi_[edge.to] - phi_[edge.from]));
      right_side_[edge.from] -= missing;
      right_side_[edge.to] += missing;
    }
    for (std::size_t i = 0; i < part_.size(); ++i)
      if (part_[i] == static_cast<int>(i)) right_side_[static_cast<int>(i)] = Scalar{0};
    correction_ = factor_.solve(right_side_);
    phi_ += correction_;
  }
  curl_free_x_.fill(Scalar{0});
  curl_free_y_.fill(Scalar{0});
  for (const Edge& edge : edges_) {
    if (!(weight(edge) > 0)) continue;
    const auto k = as_size(edge.lenslet);
    const Scalar half = Scalar{0.5F} * (phi_[edge.to] - phi_[edge.from]);
    curl_free_x_[k] += edge.rising ? -half : half;
    curl_free_y_[k] += half;
  }
}

template class PlainSplit<float>;
template class PlainSplit<double>;

}  // namespace curlew
