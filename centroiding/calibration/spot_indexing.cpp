#include "centroiding/calibration/spot_indexing.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <queue>

namespace curlew {
namespace {

// A neighbour must lie within this distance, in pitches, of the place where the numbered spots
// round it expect it.
constexpr double kReach = 0.30;

double square(double x) { return x * x; }

constexpr std::array<LensletIndex, 4> kNeighbours{{{1, 0}, {-1, 0}, {0, 1}, {0, -1}}};

/// A Flood walks over the spots. It keeps a heap of numbered spots whose neighbours it has not yet
/// looked at, the brightest first.
class Flood {
 public:
  Flood(const std::vector<Spot>& candidates, const LensletGrid& grid)
      : candidates_(candidates), grid_(grid) {}

  IndexedSpots run() {
    const std::size_t seed = best_seed();
    take({0, 0}, seed);
    while (!open_.empty()) {
      const LensletIndex at = open_.top().second;
      open_.pop();
      for (const LensletIndex& step : kNeighbours) {
        const LensletIndex next{at.first + step.first, at.second + step.second};
        if (taken_.contains(next)) continue;
        const auto [x, y] = expect(next);
        const std::size_t near = nearest(x, y);
        if (near < candidates_.size()) take(next, near);
      }
    }
    return taken_;
  }

 private:
  /// Returns the candidate nearest to (x, y) within reach, or candidates_.size() if there is none.
  std::size_t nearest(double x, double y) const {
    std::size_t best = candidates_.size();
    double minimum = square(kReach * grid_.pitch_px());
    for (std::size_t i = 0; i < candidates_.size(); ++i) {
      const double d = square(candidates_[i].x - x) + square(candidates_[i].y - y);
      if (d < minimum) {
        minimum = d;
        best = i;
      }
    }
    return best;
  }

  /// Returns the candidate with neighbours on four sides whose dimmest neighbour is brightest. If
  /// no candidate has four neighbours, one with as many as possible is taken.
  std::size_t best_seed() const {
    std::size_t best = 0;
    std::pair<int, double> best_score{-1, 0.0};
    for (std::size_t i = 0; i < candidates_.size(); ++i) {
      std::pair<int, double> score{0, candidates_[i].height};
      for (const auto& [dc, dr] : kNeighbours) {
        const std::size_t near = nearest(candidates_[i].x + grid_.p11 * dc + grid_.p12 * dr,
                                         candidates_[i].y + grid_.p21 * dc + grid_.p22 * dr);
        if (near == candidates_.size()) continue;
        ++score.first;
        score.second = std::min(score.second, candidates_[near].height);
      }
      if (score > best_score) {
        best_score = score;
        best = i;
      }
    }
    return best;
  }

  /// Returns the mean of the places that the numbered spots around predict.
  std::array<double, 2> expect(const LensletIndex& at) const {
    double x = 0.0;
    double y = 0.0;
    int n = 0;
    for (int dr = -1; dr <= 1; ++dr) {
      for (int dc = -1; dc <= 1; ++dc) {
        const auto it = taken_.find({at.first + dc, at.second + dr});
        if (it == taken_.end()) continue;
        x += it->second.x - grid_.p11 * dc - grid_.p12 * dr;
        y += it->second.y - grid_.p21 * dc - grid_.p22 * dr;
        ++n;
      }
    }
    return {x / n, y / n};
  }

  void take(const LensletIndex& at, std::size_t candidate) {
    taken_[at] = candidates_[candidate];
    open_.emplace(candidates_[candidate].height, at);
  }

  const std::vector<Spot>& candidates_;
  const LensletGrid& grid_;
  IndexedSpots taken_;
  std::priority_queue<std::pair<double, LensletIndex>> open_;
};

}  // namespace

IndexedSpots index_spots(const std::vector<Spot>& candidates, const LensletGrid& grid) {
  if (candidates.empty()) return {};
  return Flood(candidates, grid).run();
}

}  // namespace curlew
