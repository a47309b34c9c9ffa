#include "centroiding/calibration/spot_indexing.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <queue>

#include "core/image.h"

namespace curlew {
namespace {

// A neighbour must lie within this distance, in pitches, of the place where the numbered spots
// round it expect it.
constexpr double kReach = 0.30;

double square(double x) { return x * x; }

constexpr std::array<LensletIndex, 4> kNeighbours{{{1, 0}, {-1, 0}, {0, 1}, {0, -1}}};

/// NearestSpot finds the spot that is nearest to a place, within reach of it. The spots lie in
/// squares with a side of one pitch, so that only those of nine squares are looked at.
class NearestSpot {
 public:
  NearestSpot(const std::vector<Spot>& spots, double pitch_px) : spots_(spots), pitch_(pitch_px) {
    double width = 0.0;
    double height = 0.0;
    for (const Spot& spot : spots) {
      width = std::max(width, spot.x);
      height = std::max(height, spot.y);
    }
    squares_ = Image<std::vector<std::size_t>>(square_of(height) + 1, square_of(width) + 1);
    for (std::size_t i = 0; i < spots.size(); ++i)
      squares_(square_of(spots[i].y), square_of(spots[i].x)).push_back(i);
  }

  /// Returns which spot it is, the first of those equally near; the number of spots if there is
  /// none. x and y are in px.
  std::size_t operator()(double x, double y) const {
    std::size_t best = spots_.size();
    double minimum = square(kReach * pitch_);
    const int row = square_of(y);
    const int col = square_of(x);
    for (int r = row - 1; r <= row + 1; ++r) {
      for (int c = col - 1; c <= col + 1; ++c) {
        if (!squares_.contains(r, c)) continue;
        for (const std::size_t i : squares_(r, c)) {
          const double d = square(spots_[i].x - x) + square(spots_[i].y - y);
          const bool first_of_equals = d == minimum && best < spots_.size() && i < best;
          if (d >= minimum && !first_of_equals) continue;
          minimum = d;
          best = i;
        }
      }
    }
    return best;
  }

 private:
  int square_of(double at_px) const { return static_cast<int>(std::floor(at_px / pitch_)); }

  const std::vector<Spot>& spots_;
  double pitch_;
  Image<std::vector<std::size_t>> squares_;
};

/// A Flood walks over the spots. It keeps a heap of numbered spots whose neighbours it has not yet
/// looked at, the brightest first.
class Flood {
 public:
  Flood(const std::vector<Spot>& candidates, const LensletGrid& grid)
      : candidates_(candidates), grid_(grid), nearest_(candidates, grid.pitch_px()) {}

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
        const std::size_t near = nearest_(x, y);
        if (near < candidates_.size()) take(next, near);
      }
    }
    return taken_;
  }

 private:
  /// Returns the candidate with neighbours on four sides whose dimmest neighbour is brightest. If
  /// no candidate has four neighbours, one with as many as possible is taken.
  std::size_t best_seed() const {
    std::size_t best = 0;
    std::pair<int, double> best_score{-1, 0.0};
    for (std::size_t i = 0; i < candidates_.size(); ++i) {
      std::pair<int, double> score{0, candidates_[i].height};
      for (const auto& [dc, dr] : kNeighbours) {
        const std::size_t near = nearest_(candidates_[i].x + grid_.p11 * dc + grid_.p12 * dr,
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
  const NearestSpot nearest_;
  IndexedSpots taken_;
  std::priority_queue<std::pair<double, LensletIndex>> open_;
};

}  // namespace

IndexedSpots index_spots(const std::vector<Spot>& candidates, const LensletGrid& grid) {
  if (candidates.empty()) return {};
  return Flood(candidates, grid).run();
}

}  // namespace curlew
