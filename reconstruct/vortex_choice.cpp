#include "reconstruct/vortex_choice.h"

#include <algorithm>
#include <cmath>

#include "core/as_size.h"
#include "reconstruct/vortex_loops.h"

namespace curlew {
namespace {

class Chooser {
 public:
  Chooser(const VortexChoicePlan& plan, VortexChoiceWorkspace& ws) : plan_(plan), ws_(ws) {}

  void run(const VortexList& candidates, const SlopeField& slopes, VortexList& chosen) {
    take(candidates);
    for (std::size_t t = 0; t < plan_.tiles().size(); ++t) {
      tile_ = &plan_.tiles()[t];
      if (!gather(static_cast<std::int32_t>(t))) continue;
      clear_loops();
      add_measured(slopes);
      add_candidates();
      multiply();
      go_downhill();
      for (std::size_t i = 0; i < ws_.local.size(); ++i)
        if (ws_.tile[ws_.local[i]] == static_cast<std::int32_t>(t))
          ws_.believed[ws_.local[i]] = ws_.chosen[i];
    }
    for (std::size_t i = 0; i < ws_.candidates.size(); ++i)
      if (ws_.believed[i] != 0) chosen.push(ws_.candidates[i]);
  }

 private:
  float probability_of(const Vortex& vortex) const {
    return vortex.probability >= 0.0F ? vortex.probability : plan_.options().unknown_probability;
  }

  void take(const VortexList& candidates) {
    ws_.candidates.clear();
    for (const Vortex& vortex : candidates) {
      if (vortex.charge == 0 || !near(vortex, 0, 0, plan_.rows(), plan_.cols())) continue;
      if (!(probability_of(vortex) >= plan_.options().min_probability)) continue;
      const std::size_t i = ws_.candidates.size();
      if (!ws_.candidates.push(vortex)) continue;
      ws_.tile[i] = plan_.tile_at(vortex.x, vortex.y);
      ws_.believed[i] = 0;
    }
  }

  /// Returns whether a vortex lies on this part of the array or up to 2 pitches off it.
  static bool near(const Vortex& vortex, int row, int col, int rows, int cols) {
    const auto within = [](float x, int first, int n) {
      return x >= static_cast<float>(first - 2) && x <= static_cast<float>(first + n + 1);
    };
    return within(vortex.x, col, cols) && within(vortex.y, row, rows);
  }

  /// Gathers the candidates in a tile or near it. Returns false if none belongs to the tile.
  bool gather(std::int32_t t) {
    const Lattice& lattice = tile_->lattice();
    bool any = false;
    ws_.local.clear();
    for (std::size_t v = 0; v < ws_.candidates.size(); ++v) {
      const Vortex& vortex = ws_.candidates[v];
      if (!near(vortex, tile_->row(), tile_->col(), lattice.rows(), lattice.cols())) continue;
      any = any || ws_.tile[v] == t;
      const std::size_t i = ws_.local.size();
      ws_.local.push(v);
      const float p = std::clamp(probability_of(vortex), 1e-3F, 1.0F - 1e-3F);
      ws_.cost[i] = -plan_.options().prior_weight * std::log(p / (1.0F - p));
      ws_.chosen[i] = p >= 0.5F ? 1 : 0;
    }
    return any;
  }

  static constexpr std::size_t kLanes = CholeskyFactor::kLanes;
  std::size_t faces() const { return as_size(tile_->factor().size()); }
  /// Returns how many groups of kLanes the measured loops and those of the candidates are.
  std::size_t groups() const { return ws_.local.size() / kLanes + 1; }
  float* group(std::size_t g) { return ws_.loops.data() + g * faces() * kLanes; }
  /// Returns the loops of a vector. Those of the next face lie kLanes further on.
  float* vector(std::size_t i) { return group(i / kLanes) + i % kLanes; }

  void clear_loops() { std::fill_n(ws_.loops.begin(), groups() * faces() * kLanes, 0.0F); }

  void add_measured(const SlopeField& slopes) {
    float* const measured = vector(0);
    for (const ChoiceTile::Lenslet& lenslet : tile_->lenslets()) {
      const int k = lenslet.row * slopes.cols() + lenslet.col;
      float x = slopes.x[as_size(k)];
      float y = slopes.y[as_size(k)];
      if (slopes.valid[as_size(k)] == 0) mean_of_neighbours(slopes, k, x, y);
      const auto along = along_corners(x, y);
      for (std::size_t i = 0; i < along.size(); ++i)
        if (lenslet.unknown[i] >= 0) measured[as_size(lenslet.unknown[i]) * kLanes] += along[i];
    }
  }

  static void mean_of_neighbours(const SlopeField& slopes, int k, float& x, float& y) {
    const int row = k / slopes.cols();
    const int col = k % slopes.cols();
    float n = 0.0F;
    x = y = 0.0F;
    for (int r = row - 1; r <= row + 1; ++r) {
      for (int c = col - 1; c <= col + 1; ++c) {
        if (!slopes.valid.contains(r, c) || slopes.valid(r, c) == 0) continue;
        x += slopes.x(r, c);
        y += slopes.y(r, c);
        n += 1.0F;
      }
    }
    if (n > 0.0F) {
      x /= n;
      y /= n;
    }
  }

  void add_candidates() {
    for (std::size_t v = 0; v < ws_.local.size(); ++v) {
      const Vortex& vortex = ws_.candidates[ws_.local[v]];
      const float x = vortex.x - static_cast<float>(tile_->col());
      const float y = vortex.y - static_cast<float>(tile_->row());
      const auto loops =
          vortex_loops(x, y, static_cast<float>(vortex.charge), plan_.options().softening);
      float* const of_vortex = vector(v + 1);
      for_each_cell(tile_->lattice(), x, y, [&](int corner, int i, int j) {
        const std::int32_t unknown = tile_->unknown_of(corner);
        if (unknown >= 0) of_vortex[as_size(unknown) * kLanes] += loops[as_size(i * kLoopSide + j)];
      });
    }
  }

  /// Computes the overlaps of all candidates, and the gain of each: its product with the loops that
  /// those chosen at the start do not explain.
  void multiply() {
    const CholeskyFactor& factor = tile_->factor();
    for (std::size_t g = 0; g < groups(); ++g) factor.solve_lower_in_place(group(g));
    for (std::size_t g = 0; g < groups(); ++g)
      for (std::size_t h = 0; h <= g; ++h)
        multiply_lanes(group(g), group(h), factor.size(),
                       &ws_.overlap(static_cast<int>(g * kLanes), static_cast<int>(h * kLanes)),
                       ws_.overlap.cols());
    const std::size_t n = ws_.local.size();
    for (std::size_t a = 0; a < n; ++a) {
      ws_.gain[a] = ws_.overlap(static_cast<int>(a) + 1, 0);
      for (std::size_t b = 0; b < n; ++b)
        if (ws_.chosen[b] != 0) ws_.gain[a] -= overlap(a, b);
    }
  }

  float overlap(std::size_t a, std::size_t b) const {
    return ws_.overlap(static_cast<int>(std::max(a, b)) + 1, static_cast<int>(std::min(a, b)) + 1);
  }

  /// Returns by how much the cost changes when candidate a is added or taken away. The squares of a
  /// lenslet's edges sum to twice those of its slopes, which scale() accounts for.
  float change(std::size_t a) {
    const float sign = ws_.chosen[a] != 0 ? -1.0F : 1.0F;
    return scale() * (overlap(a, a) - 2.0F * sign * ws_.gain[a]) + sign * ws_.cost[a];
  }
  float scale() const { return 0.25F / plan_.options().slope_variance; }

  void flip(std::size_t a) {
    const float sign = ws_.chosen[a] != 0 ? -1.0F : 1.0F;
    ws_.chosen[a] ^= 1U;
    for (std::size_t b = 0; b < ws_.local.size(); ++b) ws_.gain[b] -= sign * overlap(b, a);
  }

  void go_downhill() {
    constexpr float kEnough = -1e-3F;
    const std::size_t n = ws_.local.size();
    for (std::size_t round = 0; round < 2 * n; ++round) {
      float best = kEnough;
      std::size_t best_a = n;
      std::size_t best_b = n;
      for (std::size_t a = 0; a < n; ++a) {
        const float alone = change(a);
        if (alone < best) {
          best = alone;
          best_a = a;
          best_b = n;
        }
        const float sign = ws_.chosen[a] != 0 ? -2.0F * scale() : 2.0F * scale();
        for (std::size_t b = 0; b < a; ++b) {
          const float both =
              alone + change(b) + (ws_.chosen[b] != 0 ? -sign : sign) * overlap(a, b);
          if (both >= best) continue;
          best = both;
          best_a = a;
          best_b = b;
        }
      }
      if (best_a == n) return;
      flip(best_a);
      if (best_b < n) flip(best_b);
    }
  }

  const VortexChoicePlan& plan_;
  VortexChoiceWorkspace& ws_;
  const ChoiceTile* tile_ = nullptr;
};

/// Returns how many vectors of loops a tile has at most, rounded up to whole groups.
std::size_t vectors(const VortexChoicePlan& plan) {
  constexpr std::size_t kLanes = CholeskyFactor::kLanes;
  return (plan.capacity() / kLanes + 1) * kLanes;
}

/// Returns how many faces a tile has at most, and at least 1.
std::size_t most_faces(const VortexChoicePlan& plan) {
  int most = 1;
  for (const ChoiceTile& tile : plan.tiles()) most = std::max(most, tile.factor().size());
  return as_size(most);
}

}  // namespace

VortexChoiceWorkspace::VortexChoiceWorkspace(const VortexChoicePlan& plan)
    : candidates(plan.capacity()),
      tile(plan.capacity()),
      believed(plan.capacity()),
      local(plan.capacity()),
      loops(vectors(plan) * most_faces(plan)),
      overlap(static_cast<int>(vectors(plan)), static_cast<int>(vectors(plan))),
      gain(plan.capacity()),
      cost(plan.capacity()),
      chosen(plan.capacity()) {}

void choose_vortices(const VortexChoicePlan& plan, const VortexList& candidates,
                     const SlopeField& slopes, VortexChoiceWorkspace& workspace,
                     VortexList& chosen) noexcept {
  chosen.clear();
  Chooser(plan, workspace).run(candidates, slopes, chosen);
}

}  // namespace curlew
