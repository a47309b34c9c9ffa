#include "reconstruct/branch_cuts.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "core/as_size.h"

namespace curlew {
namespace {

constexpr float kPi = 3.14159265358979F;
constexpr std::int32_t kBuckets = 256;  // more than the largest cost of an edge
constexpr std::int32_t kFar = std::numeric_limits<std::int32_t>::max() / 4;
// This limit is generous: where 250 residues had 40 possible partners each, cuts were as short with
// 64, and 12 were too few.
constexpr std::size_t kMaxPartners = 128;
constexpr std::int8_t kSource = 4;     // value of came_by where the path begins
constexpr std::int32_t kOutside = -1;  // distance of what is no cell

/// The sides of a cell are top, right, bottom and left. The way round the cell runs along its top
/// edge to the right and down its right edge. It passes the other two edges against their sense,
/// which is what −1 says.
constexpr int kAlong[4] = {1, 1, -1, -1};

/// Returns how many whole turns must be taken off a difference to bring it into [−π, π].
std::int32_t turns_of(float difference) {
  if (difference > kPi) return 1;
  return difference < -kPi ? -1 : 0;
}

class Cutter {
 public:
  Cutter(const Image<float>& wrapped, BranchCutWorkspace& ws)
      : wrapped_(wrapped),
        ws_(ws),
        rows_(wrapped.rows()),
        cols_(wrapped.cols()),
        steps_{-cols_, 1, cols_, -1} {}

  void run(const Image<float>& flux, const Image<std::uint8_t>& valid, Image<float>& unwrapped) {
    find_residues();
    if (!ws_.residues.empty()) {
      price_edges(flux, valid);
      grow_regions();
      join_regions();
      pair_residues();
    }
    list_cuts(flux, valid);
    add_turns(unwrapped);
  }

 private:
  std::int32_t cell_at(int row, int col) const { return (row + 1) * cols_ + col; }
  std::int32_t terminals() const { return static_cast<std::int32_t>(ws_.residues.size()) + 1; }
  std::int32_t outside() const { return terminals() - 1; }

  /// Finds the turns that the short way between neighbours takes off their difference, and the
  /// residues that follow. The cuts are added to these turns later.
  void find_residues() {
    for (int r = 0; r < rows_; ++r) {
      for (int c = 0; c < cols_; ++c) {
        const float here = wrapped_(r, c);
        ws_.turns_right(r, c) = c + 1 < cols_ ? turns(wrapped_(r, c + 1) - here) : std::int8_t{0};
        ws_.turns_down(r, c) = r + 1 < rows_ ? turns(wrapped_(r + 1, c) - here) : std::int8_t{0};
      }
    }
    ws_.residues.clear();
    for (int r = 0; r + 1 < rows_; ++r) {
      for (int c = 0; c + 1 < cols_; ++c) {
        const int charge = ws_.turns_right(r, c) + ws_.turns_down(r, c + 1) -
                           ws_.turns_right(r + 1, c) - ws_.turns_down(r, c);
        // The short differences round the cell add up to −2π·charge, where `charge` counts the
        // turns taken off.
        if (charge != 0) ws_.residues.push({cell_at(r, c), -charge});
      }
    }
  }

  static std::int8_t turns(float difference) {
    return static_cast<std::int8_t>(turns_of(difference));
  }

  void price_edges(const Image<float>& flux, const Image<std::uint8_t>& valid) {
    double sum = 0.0;
    int n = 0;
    for (std::size_t k = 0; k < flux.size(); ++k) {
      if (valid[k] == 0) continue;
      sum += static_cast<double>(std::max(flux[k], 0.0F));
      ++n;
    }
    const float scale = sum > 0.0 ? static_cast<float>(16.0 * n / sum) : 0.0F;
    const auto light = [&](std::size_t k) {
      return valid[k] != 0 ? std::max(flux[k], 0.0F) : 0.0F;
    };
    const auto cost = [&](std::size_t a, std::size_t b) {
      const float value = 1.5F + scale * (light(a) + light(b));
      return static_cast<std::int32_t>(std::min(value, static_cast<float>(kBuckets - 1)));
    };
    for (int r = 0; r < rows_; ++r) {
      for (int c = 0; c < cols_; ++c) {
        const auto k = as_size(r * cols_ + c);
        const std::size_t cell = as_size(cell_at(r, c));
        ws_.cost_right[cell] = c + 1 < cols_ ? cost(k, k + 1) : 0;
        ws_.cost_down[cell] = r + 1 < rows_ ? cost(k, k + as_size(cols_)) : 0;
      }
    }
  }

  /// This is the edge on one side of a cell: the cell whose first lenslet is the edge's, and
  /// whether it runs to the right.
  struct Edge {
    std::int32_t cell;
    bool right;
  };
  Edge edge_of(std::int32_t cell, int side) const {
    return {side == 1 || side == 2 ? beyond(cell, side) : cell, side % 2 == 0};
  }
  std::int32_t cost_of(std::int32_t cell, int side) const {
    const Edge edge = edge_of(cell, side);
    return (edge.right ? ws_.cost_right : ws_.cost_down)[as_size(edge.cell)];
  }
  std::int32_t beyond(std::int32_t cell, int side) const {
    return cell + steps_[static_cast<unsigned>(side)];
  }
  bool is_outside(std::int32_t cell) const { return ws_.distance[as_size(cell)] == kOutside; }

  /// Calls use(cell) for all cells of the array.
  template <typename Use>
  void for_each_cell(Use use) const {
    for (int r = 0; r + 1 < rows_; ++r)
      for (int c = 0; c + 1 < cols_; ++c) use(cell_at(r, c));
  }

  /// Grows shortest paths from every residue and from outside the array, so that each cell belongs
  /// to the nearest of these.
  void grow_regions() {
    std::fill(ws_.distance.begin(), ws_.distance.end(), kOutside);
    std::fill(ws_.owner.begin(), ws_.owner.end(), outside());
    for_each_cell([&](std::int32_t cell) { ws_.distance[as_size(cell)] = kFar; });
    std::fill(ws_.bucket.begin(), ws_.bucket.end(), -1);
    n_entries_ = 0;
    waiting_ = 0;
    for (std::int32_t i = 0; i < outside(); ++i)
      reach(ws_.residues[as_size(i)].cell, 0, i, kSource);
    for_each_cell([&](std::int32_t cell) {
      for (int side = 0; side < 4; ++side)
        if (is_outside(beyond(cell, side)))
          reach(cell, cost_of(cell, side), outside(), static_cast<std::int8_t>(side));
    });
    for (std::int32_t at = 0; waiting_ > 0; ++at) {
      std::int32_t& head = ws_.bucket[as_size(at % kBuckets)];
      while (head >= 0) {
        const std::int32_t entry = head;
        head = ws_.next[as_size(entry)];
        --waiting_;
        const std::int32_t cell = ws_.entry_cell[as_size(entry)];
        if (ws_.entry_distance[as_size(entry)] != ws_.distance[as_size(cell)]) continue;
        for (int side = 0; side < 4; ++side)
          reach(beyond(cell, side), at + cost_of(cell, side), ws_.owner[as_size(cell)],
                static_cast<std::int8_t>((side + 2) % 4));
      }
    }
  }

  void reach(std::int32_t cell, std::int32_t distance, std::int32_t owner, std::int8_t by) {
    if (distance >= ws_.distance[as_size(cell)]) return;
    if (n_entries_ == static_cast<std::int32_t>(ws_.next.size())) return;
    ws_.distance[as_size(cell)] = distance;
    ws_.owner[as_size(cell)] = owner;
    ws_.came_by[as_size(cell)] = by;
    const std::int32_t entry = n_entries_++;
    ws_.entry_cell[as_size(entry)] = cell;
    ws_.entry_distance[as_size(entry)] = distance;
    ws_.next[as_size(entry)] = ws_.bucket[as_size(distance % kBuckets)];
    ws_.bucket[as_size(distance % kBuckets)] = entry;
    ++waiting_;
  }

  /// Finds the ways between neighbouring regions, and from them the ways between all (Floyd and
  /// Warshall).
  void join_regions() {
    const std::int32_t n = terminals();
    for (std::int32_t i = 0; i < n; ++i) {
      for (std::int32_t j = 0; j < n; ++j) {
        ws_.between(i, j) = i == j ? 0 : kFar;
        ws_.via(i, j) = j;
      }
    }
    for_each_cell([&](std::int32_t cell) {
      const std::int32_t a = ws_.owner[as_size(cell)];
      for (int side = 0; side < 4; ++side) {
        const std::int32_t other = beyond(cell, side);
        const std::int32_t b = ws_.owner[as_size(other)];
        if (a == b) continue;
        const std::int32_t length = ws_.distance[as_size(cell)] + cost_of(cell, side) +
                                    std::max(ws_.distance[as_size(other)], 0);
        if (length >= ws_.between(a, b)) continue;
        ws_.between(a, b) = ws_.between(b, a) = length;
        ws_.contact(a, b) = ws_.contact(b, a) = 4 * cell + side;
      }
    });
    for (std::int32_t k = 0; k < n; ++k) {
      const std::int32_t* const from_k = &ws_.between(k, 0);
      for (std::int32_t i = 0; i < n; ++i) {
        const std::int32_t first = ws_.between(i, k);
        if (i == k || first >= kFar) continue;
        const std::int32_t via_k = ws_.via(i, k);
        std::int32_t* __restrict between = &ws_.between(i, 0);
        std::int32_t* __restrict via = &ws_.via(i, 0);
        for (std::int32_t j = 0; j < n; ++j) {
          const std::int32_t length = first + from_k[j];
          via[j] = length < between[j] ? via_k : via[j];
          between[j] = std::min(length, between[j]);
        }
      }
    }
  }

  /// Pairs opposite residues so that the cuts are as cheap as possible, compared with every residue
  /// going outside by itself.
  void pair_residues() {
    std::size_t n_positive = 0;
    std::size_t n_negative = 0;
    for (std::int32_t i = 0; i < outside(); ++i) {
      if (ws_.residues[as_size(i)].charge > 0)
        ws_.positive[n_positive++] = i;
      else
        ws_.negative[n_negative++] = i;
    }
    ws_.assignment.clear(n_positive, n_negative);
    for (std::size_t row = 0; row < n_positive; ++row) {
      const std::int32_t from = ws_.positive[row];
      for (std::size_t col = 0; col < n_negative; ++col) {
        const std::int32_t to = ws_.negative[col];
        const std::int32_t gain =
            ws_.between(from, outside()) + ws_.between(to, outside()) - ws_.between(from, to);
        ws_.assignment.allow(row, col, static_cast<float>(gain));
      }
    }
    ws_.assignment.solve();
    for (std::size_t row = 0; row < n_positive; ++row) {
      const std::int32_t col = ws_.assignment.col_of_row()[row];
      lay_cut(ws_.positive[row], col < 0 ? outside() : ws_.negative[as_size(col)], 1);
    }
    for (std::size_t col = 0; col < n_negative; ++col)
      if (ws_.assignment.row_of_col()[col] < 0) lay_cut(ws_.negative[col], outside(), -1);
  }

  /// Carries a charge from one terminal to another, through the terminals on the way.
  void lay_cut(std::int32_t from, std::int32_t to, int charge) {
    while (from != to) {
      const std::int32_t step = ws_.via(from, to);
      const std::int32_t contact = ws_.contact(from, step);
      const std::int32_t cell = contact / 4;
      const int side = contact % 4;
      const std::int32_t other = beyond(cell, side);
      const bool forward = ws_.owner[as_size(cell)] == from;
      const int carried = forward ? charge : -charge;  // charge carried from `cell` to `other`
      carry(cell, side, carried);
      retrace(cell, -carried);
      if (!is_outside(other)) retrace(other, carried);
      from = step;
    }
  }

  /// Moves a charge out of a cell through one of its sides. The sum round the cell falls by this
  /// charge.
  void carry(std::int32_t cell, int side, int charge) {
    const Edge edge = edge_of(cell, side);
    auto& turns = (edge.right ? ws_.turns_right : ws_.turns_down)[as_size(edge.cell - cols_)];
    turns = static_cast<std::int8_t>(turns + charge * kAlong[side]);
  }

  /// Carries a charge from a cell back to where its shortest path began.
  void retrace(std::int32_t cell, int charge) {
    while (!is_outside(cell) && ws_.came_by[as_size(cell)] != kSource) {
      const int side = static_cast<unsigned char>(ws_.came_by[as_size(cell)]);
      carry(cell, side, charge);
      cell = beyond(cell, side);
    }
  }

  void list_cuts(const Image<float>& flux, const Image<std::uint8_t>& valid) {
    ws_.cuts.clear();
    ws_.light_cut = 0.0;
    for (int r = 0; r < rows_; ++r) {
      for (int c = 0; c < cols_; ++c) {
        const std::int32_t k = r * cols_ + c;
        const auto add = [&](std::int32_t to, int turns) {
          const int shortest = turns_of(wrapped_[as_size(to)] - wrapped_[as_size(k)]);
          if (turns == shortest) return;
          ws_.cuts.push({k, to, shortest - turns});
          for (const std::int32_t lenslet : {k, to})
            if (valid[as_size(lenslet)] != 0)
              ws_.light_cut += static_cast<double>(flux[as_size(lenslet)]);
        };
        if (c + 1 < cols_) add(k + 1, ws_.turns_right[as_size(k)]);
        if (r + 1 < rows_) add(k + cols_, ws_.turns_down[as_size(k)]);
      }
    }
  }

  void add_turns(Image<float>& unwrapped) {
    int first = 0;
    for (int r = 0; r < rows_; ++r) {
      int turns = first;
      for (int c = 0; c < cols_; ++c) {
        unwrapped(r, c) = wrapped_(r, c) - 2.0F * kPi * static_cast<float>(turns);
        turns += ws_.turns_right(r, c);
      }
      first += ws_.turns_down(r, 0);
    }
  }

  const Image<float>& wrapped_;
  BranchCutWorkspace& ws_;
  int rows_;
  int cols_;
  std::array<std::int32_t, 4> steps_;  // from a cell to the cells beyond its sides
  std::int32_t n_entries_ = 0;
  std::int32_t waiting_ = 0;
};

}  // namespace

BranchCutWorkspace::BranchCutWorkspace(int rows, int cols, std::size_t capacity)
    : residues(capacity),
      cuts(2 * as_size(rows) * as_size(cols)),
      turns_right(rows, cols),
      turns_down(rows, cols),
      cost_right(as_size(rows + 1) * as_size(cols)),
      cost_down(cost_right.size()),
      distance(cost_right.size()),
      owner(cost_right.size()),
      came_by(cost_right.size()),
      bucket(as_size(kBuckets)),
      next(8 * turns_right.size()),
      entry_cell(next.size()),
      entry_distance(next.size()),
      between(static_cast<int>(capacity) + 1, static_cast<int>(capacity) + 1),
      via(between.rows(), between.cols()),
      contact(between.rows(), between.cols()),
      positive(capacity),
      negative(capacity),
      assignment(capacity, capacity, std::min(capacity, kMaxPartners)) {}

void unwrap_with_cuts(const Image<float>& wrapped, const Image<float>& flux,
                      const Image<std::uint8_t>& valid, BranchCutWorkspace& workspace,
                      Image<float>& unwrapped) noexcept {
  Cutter(wrapped, workspace).run(flux, valid, unwrapped);
}

}  // namespace curlew
