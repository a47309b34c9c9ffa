#include "reconstruct/dissection.h"

#include <algorithm>
#include <limits>

namespace curlew {
namespace {

constexpr int kSide = TileShape::kSide;

/// Returns where to cut a box that spans [first, last) without the lines at its ends: on the line
/// that divides the most regularly, so that many parts are alike, but not too near an end. Lines
/// are at multiples of kSide.
int cut_of(int first, int last) {
  const int low = first - 1;
  const int high = last;
  int best = 0;
  int best_power = 0;
  for (int line = low + kSide; line < high; line += kSide) {
    if (4 * std::min(line - low, high - line) < high - low) continue;
    int power = 1;
    while (power < (1 << 20) && line % (2 * power) == 0) power *= 2;
    const bool nearer = std::abs(2 * line - low - high) < std::abs(2 * best - low - high);
    if (power < best_power || (power == best_power && !nearer)) continue;
    best = line;
    best_power = power;
  }
  return best;
}

using Adjacency = std::array<std::array<bool, TileShape::kNodes>, TileShape::kNodes>;

void join(Adjacency& touches, int a, int b) {
  touches[as_size(a)][as_size(b)] = touches[as_size(b)][as_size(a)] = a != b;
}

/// Returns the nodes inside a tile in the order in which they are best eliminated: always the one
/// that touches the fewest others.
std::vector<int> order_of_least_degree(Adjacency touches) {
  std::vector<int> order;
  std::vector<bool> gone(TileShape::kNodes, false);
  for (int n = 0; n < TileShape::kInside; ++n) {
    int best = -1;
    std::ptrdiff_t fewest = TileShape::kNodes;
    for (int i = 0; i < TileShape::kInside; ++i) {
      const auto& row = touches[as_size(i)];
      const auto degree = std::count(row.begin(), row.end(), true);
      if (gone[as_size(i)] || degree >= fewest) continue;
      best = i;
      fewest = degree;
    }
    order.push_back(best);
    gone[as_size(best)] = true;
    std::vector<int> others;
    for (int i = 0; i < TileShape::kNodes; ++i)
      if (touches[as_size(best)][as_size(i)]) others.push_back(i);
    for (const int a : others) {
      touches[as_size(a)][as_size(best)] = false;
      for (const int b : others) join(touches, a, b);
    }
  }
  return order;
}

}  // namespace

TileShape::TileShape() {
  std::vector<Place> raster;
  for (int u = 1; u < kSide; ++u)
    for (int v = 1; v < kSide; ++v) raster.push_back({u, v});
  for (int i = 1; i < kSide; ++i)
    for (const Place side : {Place{0, i}, Place{kSide, i}, Place{i, 0}, Place{i, kSide}})
      raster.push_back(side);
  const auto inside = [](Place p) { return p.u > 0 && p.u < kSide && p.v > 0 && p.v < kSide; };
  const auto neighbours = [&](Place a, Place b) {
    return std::abs(a.u - b.u) + std::abs(a.v - b.v) == 1 && (inside(a) || inside(b));
  };
  Adjacency touches{};
  for (int a = 0; a < kNodes; ++a)
    for (int b = 0; b < a; ++b)
      if (neighbours(raster[as_size(a)], raster[as_size(b)])) join(touches, a, b);
  const std::vector<int> order = order_of_least_degree(touches);
  for (int i = 0; i < kNodes; ++i)
    place[as_size(i)] = raster[as_size(i < kInside ? order[as_size(i)] : i)];

  touches = {};
  for (int a = 0; a < kNodes; ++a) {
    for (int b = a + 1; b < kNodes; ++b) {
      const Place from = place[as_size(a)];
      const Place to = place[as_size(b)];
      if (!neighbours(from, to)) continue;
      join(touches, a, b);
      edges.push_back({a, b, {std::min(from.u, to.u), std::min(from.v, to.v)}, from.v == to.v});
    }
  }
  for (int i = 0; i < kInside; ++i) {
    for (int j = i + 1; j < kNodes; ++j)
      if (touches[as_size(i)][as_size(j)]) later[as_size(i)].push_back(j);
    for (const int a : later[as_size(i)])
      for (const int b : later[as_size(i)]) join(touches, a, b);
  }
}

std::int32_t Front::row_of(std::int32_t position) const {
  if (position < first + pivots) return position - first;
  const auto place = std::lower_bound(border.begin(), border.end(), position);
  return pivots + static_cast<std::int32_t>(place - border.begin());
}

Dissection::Dissection(const Lattice& lattice)
    : rows_(lattice.rows()), cols_(lattice.cols()), position_(as_size(lattice.n_corners())) {
  for (int corner = 0; corner < lattice.n_corners(); ++corner)
    position_[as_size(corner)] = lattice.component_of(corner) < 0 ? lattice.n_nodes() : -1;
  for (int k = 0; k < rows_ * cols_; ++k) lit_.push_back(lattice.phase_group_of(k) >= 0 ? 1 : 0);
  for (const int parity : {0, 1}) dissect_sublattice(parity);
  find_links();
  find_borders();
}

int Dissection::corner_of(int parity, int u, int v) const {
  const int row = u - v + parity;
  const int col = u + v;
  return row < 0 || row > rows_ || col < 0 || col > cols_ ? -1 : row * (cols_ + 1) + col;
}

int Dissection::position_of(int parity, int u, int v) const {
  const int corner = corner_of(parity, u, v);
  return corner < 0 ? n_nodes() : position_[as_size(corner)];
}

int Dissection::lenslet_of(int parity, int u, int v, bool along_u) const {
  // Edge A starts at corner 00 of its lenslet, and edge B, towards greater v, at corner 10.
  const int row = u - v + parity - (along_u ? 0 : 1);
  const int col = u + v;
  if (row < 0 || row >= rows_ || col < 0 || col >= cols_) return -1;
  return lit_[as_size(row * cols_ + col)] != 0 ? row * cols_ + col : -1;
}

void Dissection::dissect_sublattice(int parity) {
  constexpr int kFar = std::numeric_limits<int>::max();
  Box all{kFar, -kFar, kFar, -kFar};
  for (int u = 0; u <= (rows_ + cols_) / 2; ++u) {
    for (int v = -rows_; v <= cols_; ++v) {
      const int corner = corner_of(parity, u, v);
      if (corner < 0 || position_[as_size(corner)] >= 0) continue;
      all = {std::min(all.first_u, u), std::max(all.last_u, u + 1), std::min(all.first_v, v),
             std::max(all.last_v, v + 1)};
    }
  }
  if (all.first_u > all.last_u) return;
  // The box grows until lines bound it, on which there are no nodes.
  const auto down = [](int line) { return (line - (line % kSide + kSide) % kSide); };
  dissect(parity, {down(all.first_u - 1) + 1, down(all.last_u + kSide - 1),
                   down(all.first_v - 1) + 1, down(all.last_v + kSide - 1)});
}

bool Dissection::any_node(int parity, const Box& box) const {
  for (int u = box.first_u; u < box.last_u; ++u)
    for (int v = box.first_v; v < box.last_v; ++v)
      if (corner_of(parity, u, v) >= 0 && position_of(parity, u, v) < 0) return true;
  return false;
}

void Dissection::dissect(int parity, const Box& inside) {
  if (!any_node(parity, inside)) return;
  const int size_u = inside.last_u - inside.first_u;
  const int size_v = inside.last_v - inside.first_v;
  if (size_u < kSide && size_v < kSide) return add_tile(parity, inside);
  Box before = inside;
  Box line = inside;
  Box after = inside;
  if (size_u >= size_v) {
    before.last_u = line.first_u = cut_of(inside.first_u, inside.last_u);
    line.last_u = after.first_u = line.first_u + 1;
  } else {
    before.last_v = line.first_v = cut_of(inside.first_v, inside.last_v);
    line.last_v = after.first_v = line.first_v + 1;
  }
  dissect(parity, before);
  dissect(parity, after);
  add_line(parity, line);
}

void Dissection::add_tile(int parity, const Box& inside) {
  const Tile tile{parity, inside.first_u - 1, inside.first_v - 1};
  for (int i = 0; i < TileShape::kInside; ++i) {
    const TileShape::Place place = shape_.place[as_size(i)];
    add_node(corner_of(parity, tile.u + place.u, tile.v + place.v));
  }
  finish_front(static_cast<std::int32_t>(tiles_.size()));
  tiles_.push_back(tile);
}

void Dissection::add_line(int parity, const Box& line) {
  for (int u = line.first_u; u < line.last_u; ++u)
    for (int v = line.first_v; v < line.last_v; ++v) add_node(corner_of(parity, u, v));
  finish_front(-1);
}

void Dissection::add_node(int corner) {
  if (corner < 0 || position_[as_size(corner)] >= 0) return;
  position_[as_size(corner)] = n_nodes();
  corner_.push_back(corner);
}

/// Makes a front of the nodes that were added after the last one.
void Dissection::finish_front(std::int32_t tile) {
  Front front;
  front.first = static_cast<std::int32_t>(front_of_.size());
  front.pivots = n_nodes() - front.first;
  front.tile = tile;
  if (front.pivots == 0) return;
  front_of_.resize(corner_.size(), static_cast<std::int32_t>(fronts_.size()));
  fronts_.push_back(front);
}

void Dissection::find_links() {
  const int across = cols_ + 1;
  for (int k = 0; k < rows_ * cols_; ++k) {
    if (lit_[as_size(k)] == 0) continue;
    const int corner = k / cols_ * across + k % cols_;
    const auto add = [&](int a, int b) {
      const auto [from, to] = std::minmax(position_[as_size(a)], position_[as_size(b)]);
      links_.push_back({from, to, k});
    };
    add(corner, corner + across + 1);
    add(corner + 1, corner + across);
  }
}

/// A front touches what its nodes touch, and what the fronts that were eliminated into it do.
void Dissection::find_borders() {
  for (const Link& link : links_) {
    Front& front = fronts_[as_size(front_of_[as_size(link.from)])];
    if (link.to >= front.first + front.pivots) front.border.push_back(link.to);
  }
  for (Front& front : fronts_) {
    std::sort(front.border.begin(), front.border.end());
    front.border.erase(std::unique(front.border.begin(), front.border.end()), front.border.end());
    if (front.border.empty()) continue;
    front.parent = front_of_[as_size(front.border.front())];
    Front& parent = fronts_[as_size(front.parent)];
    for (const std::int32_t later : front.border)
      if (later >= parent.first + parent.pivots) parent.border.push_back(later);
  }
}

}  // namespace curlew
