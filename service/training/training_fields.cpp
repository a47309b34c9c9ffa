#include "service/training/training_fields.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <tuple>
#include <utility>

#include "service/results/truth_match.h"

namespace curlew {
namespace {

// In pitches. Between kHitRadius and this a node has no label.
constexpr double kIgnoreRadius = 1.0;

}  // namespace

FieldParameters training_field(int index) {
  struct Geometry {
    double lenslet;
    int window_px;
  };
  constexpr double kSamples = 4.0;  // a λ/w
  constexpr int kNarrow = kNarrowWindow_px;
  constexpr int kWide = 24;
  constexpr std::array<double, 10> kRytov{2.0, 1.0, 4.0, 1.4, 2.8, 2.0, 1.0, 4.0, 2.8, 0.4};
  constexpr std::array<Geometry, 10> kGeometries{{{0.064, kNarrow},
                                                  {0.045, kNarrow},
                                                  {0.064, kWide},
                                                  {0.09, kNarrow},
                                                  {0.064, kNarrow},
                                                  {0.032, kNarrow},
                                                  {0.064, kWide},
                                                  {0.14, kWide},
                                                  {0.064, kNarrow},
                                                  {0.064, kNarrow}}};
  constexpr double kSide = 3.84;  // √(λL), side of the propagated area
  const Geometry& geometry = kGeometries[static_cast<std::size_t>(index / 10) % kGeometries.size()];
  FieldParameters p;
  p.rytov_variance = kRytov[static_cast<std::size_t>(index) % kRytov.size()];
  p.lenslet = geometry.lenslet;
  p.window_px = geometry.window_px;
  p.samples_per_lambda_w = kSamples;
  p.rows = p.cols = std::min(60, static_cast<int>(kSide / geometry.lenslet));
  return p;
}

std::vector<UnresolvedPair> unresolved_pairs(const std::vector<GradedVortex>& graded) {
  const auto apart = [](const auto& a, const auto& b) { return std::hypot(a.x - b.x, a.y - b.y); };
  std::vector<std::tuple<double, std::size_t, std::size_t>> near;
  for (std::size_t i = 0; i < graded.size(); ++i) {
    for (std::size_t j = i + 1; j < graded.size(); ++j) {
      if (graded[i].required || graded[j].required || graded[i].charge == graded[j].charge)
        continue;
      const double distance = apart(graded[i], graded[j]);
      if (distance < kClosestRequiredPair) near.emplace_back(distance, i, j);
    }
  }
  std::sort(near.begin(), near.end());
  std::vector<bool> taken(graded.size(), false);
  std::vector<UnresolvedPair> pairs;
  for (const auto& [distance, i, j] : near) {
    if (taken[i] || taken[j]) continue;
    taken[i] = taken[j] = true;
    UnresolvedPair pair{0.5 * (graded[i].x + graded[j].x), 0.5 * (graded[i].y + graded[j].y),
                        distance, distance >= kFaintestPair};
    for (const GradedVortex& other : graded)
      pair.clear = pair.clear && !(other.required && apart(pair, other) < kHitRadius);
    pairs.push_back(pair);
  }
  return pairs;
}

Image<NodeLabel> label_nodes(const FieldParameters& p, const std::vector<GradedVortex>& truth) {
  Image<NodeLabel> labels(p.rows - 1, p.cols - 1);
  Image<std::array<double, 3>> nearest(p.rows - 1, p.cols - 1, {1e9, 1e9, 1e9});
  const auto mark = [&](double x, double y, std::size_t kind, bool certain) {
    const int row = static_cast<int>(std::floor(y));
    const int col = static_cast<int>(std::floor(x));
    for (int r = row - 2; r <= row + 2; ++r) {
      for (int c = col - 2; c <= col + 2; ++c) {
        if (!labels.contains(r, c)) continue;
        const double dx = x - c - 0.5;
        const double dy = y - r - 0.5;
        const double distance = std::hypot(dx, dy);
        Label& label = labels(r, c)[kind];
        if (distance < kIgnoreRadius && label.present == 0.0F) label.weight = 0.0F;
        if (!certain || distance > kHitRadius || distance > nearest(r, c)[kind]) continue;
        nearest(r, c)[kind] = distance;
        label = {1.0F, 1.0F, static_cast<float>(dx), static_cast<float>(dy)};
      }
    }
  };
  for (const GradedVortex& vortex : truth)
    mark(vortex.x, vortex.y, vortex.charge > 0 ? 0 : 1, vortex.required);
  for (const UnresolvedPair& pair : unresolved_pairs(truth)) mark(pair.x, pair.y, 2, pair.clear);
  return labels;
}

TrainingField make_training_field(const FieldParameters& p, Realisation realisation) {
  TrainingField field{p, std::move(realisation.light),
                      label_nodes(p, grade_vortices(realisation.vortices)),
                      Image<std::uint8_t>(p.rows - 1, p.cols - 1)};
  for (const SceneVortex& vortex : realisation.vortices) {
    for (int r = 0; r < p.rows - 1; ++r) {
      if (std::abs(r + 0.5 - vortex.y) > 2.0) continue;
      for (int c = 0; c < p.cols - 1; ++c)
        if (std::abs(c + 0.5 - vortex.x) <= 2.0) field.near_vortex(r, c) = 1;
    }
  }
  return field;
}

}  // namespace curlew
