#include "core/assignment.h"

#include <algorithm>
#include <cassert>
#include <limits>
#include <utility>

#include "core/as_size.h"

namespace curlew {
namespace {

constexpr float kUnreached = std::numeric_limits<float>::infinity();

}  // namespace

Assignment::Assignment(std::size_t max_rows, std::size_t max_cols, std::size_t pairs_per_row)
    : pairs_per_row_(pairs_per_row),
      pairs_(max_rows * pairs_per_row),
      pair_count_(max_rows),
      col_of_row_(max_rows),
      row_of_col_(max_cols),
      price_(max_cols),
      cost_(max_cols),
      reached_from_(max_cols),
      settled_(max_cols),
      reached_(max_cols) {}

void Assignment::clear(std::size_t rows, std::size_t cols) noexcept {
  assert(rows <= pair_count_.size() && cols <= price_.size());
  rows_ = rows;
  cols_ = cols;
  std::fill_n(pair_count_.begin(), rows, 0);
}

void Assignment::allow(std::size_t row, std::size_t col, float gain) noexcept {
  if (!(gain > 0.0F)) return;
  Pair* pairs = &pairs_[row * pairs_per_row_];
  std::int32_t& n = pair_count_[row];
  const Pair pair{static_cast<std::int32_t>(col), gain};
  if (as_size(n) < pairs_per_row_) {
    pairs[n++] = pair;
    return;
  }
  Pair* minimum = std::min_element(pairs, pairs + pairs_per_row_,
                                   [](const Pair& a, const Pair& b) { return a.gain < b.gain; });
  if (minimum->gain < gain) *minimum = pair;
}

void Assignment::solve() noexcept {
  std::fill_n(col_of_row_.begin(), rows_, -1);
  std::fill_n(row_of_col_.begin(), cols_, -1);
  std::fill_n(price_.begin(), cols_, 0.0F);
  std::fill_n(cost_.begin(), cols_, kUnreached);
  for (std::size_t row = 0; row < rows_; ++row) place(row);
}

// Gives `first` a column along the cheapest path, where the cost of a pair is −gain. Each row that
// loses its column on the path takes another one, until a column is free or it is cheapest to leave
// a row free. Prices reduce the costs so that the cost never falls along a path.
void Assignment::place(std::size_t first) noexcept {
  std::size_t n_reached = 0;
  const auto reach_from = [&](std::size_t row, float so_far) {
    for (std::int32_t k = 0; k < pair_count_[row]; ++k) {
      const Pair& pair = pairs_[row * pairs_per_row_ + as_size(k)];
      const std::size_t col = as_size(pair.col);
      if (settled_[col] != 0) continue;
      const float cost = so_far - pair.gain - price_[col];
      if (cost_[col] == kUnreached) reached_[n_reached++] = pair.col;
      if (cost < cost_[col]) {
        cost_[col] = cost;
        reached_from_[col] = static_cast<std::int32_t>(row);
      }
    }
  };
  // so_far is the cost of the path up to a row that has lost its column. Leaving that row free
  // costs nothing more, because the reduced cost of a pair that is assigned is 0.
  reach_from(first, 0.0F);
  float free_cost = 0.0F;  // cost of the cheapest path that leaves a row free
  auto freed = static_cast<std::int32_t>(first);
  std::int32_t end = -1;
  float end_cost = 0.0F;
  for (;;) {
    std::int32_t next = -1;
    float minimum = kUnreached;
    for (std::size_t i = 0; i < n_reached; ++i) {
      const std::size_t col = as_size(reached_[i]);
      if (settled_[col] == 0 && cost_[col] < minimum) {
        minimum = cost_[col];
        next = reached_[i];
      }
    }
    if (next < 0 || minimum >= free_cost) {
      end_cost = free_cost;
      break;
    }
    const std::int32_t holder = row_of_col_[as_size(next)];
    if (holder < 0) {
      end = next;
      end_cost = minimum;
      break;
    }
    settled_[as_size(next)] = 1;
    // The holder of `next` loses it, so the path gives back the gain of their pair.
    float gain = 0.0F;
    for (std::int32_t k = 0; k < pair_count_[as_size(holder)]; ++k) {
      const Pair& pair = pairs_[as_size(holder) * pairs_per_row_ + as_size(k)];
      if (pair.col == next) gain = pair.gain;
    }
    const float so_far = minimum + gain + price_[as_size(next)];
    if (so_far < free_cost) {
      free_cost = so_far;
      freed = holder;
    }
    reach_from(as_size(holder), so_far);
  }
  for (std::size_t i = 0; i < n_reached; ++i) {
    const std::size_t col = as_size(reached_[i]);
    if (settled_[col] != 0) price_[col] += cost_[col] - end_cost;
    settled_[col] = 0;
    cost_[col] = kUnreached;
  }
  // This assigns the pairs along the path, from its end back to `first`.
  std::int32_t col = end;
  if (end < 0) {
    if (freed == static_cast<std::int32_t>(first)) return;
    col = std::exchange(col_of_row_[as_size(freed)], -1);
  }
  for (;;) {
    const std::int32_t row = reached_from_[as_size(col)];
    row_of_col_[as_size(col)] = row;
    const std::int32_t before = std::exchange(col_of_row_[as_size(row)], col);
    if (row == static_cast<std::int32_t>(first)) return;
    col = before;
  }
}

}  // namespace curlew
