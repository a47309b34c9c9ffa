#include "service/results/truth_match.h"

#include <algorithm>
#include <cmath>
#include <tuple>

#include "acquisition/recording/fits_cube.h"
#include "acquisition/recording/recording.h"

namespace curlew {
namespace {

template <typename A, typename B>
double distance(const A& a, const B& b) {
  return std::hypot(static_cast<double>(a.x) - b.x, static_cast<double>(a.y) - b.y);
}

}  // namespace

Truth::Truth(const std::vector<std::string>& recordings, const FrameSelection& selection) {
  std::int64_t first_frame = 0;
  for (const std::string& path : recordings) {
    if (const auto truth = read_truth(path)) {
      known_ = true;
      for (TruthVortex vortex : *truth) {
        vortex.frame += first_frame;
        vortices_.push_back(vortex);
      }
    }
    first_frame += FitsCube::open(path, selection).frames;
  }
  std::stable_sort(vortices_.begin(), vortices_.end(),
                   [](const auto& a, const auto& b) { return a.frame < b.frame; });
}

std::span<const TruthVortex> Truth::of_frame(std::int64_t frame) const {
  const auto [first, last] =
      std::equal_range(vortices_.begin(), vortices_.end(), TruthVortex{frame, 0, 0, 0, 0},
                       [](const auto& a, const auto& b) { return a.frame < b.frame; });
  return {first, last};
}

TruthMatch match_truth(std::span<const Vortex> found, std::span<const TruthVortex> truth) {
  TruthMatch match;
  match.truth_of_found.assign(found.size(), -1);
  // Each holds the distance, the index into found and the index into truth.
  std::vector<std::tuple<double, std::size_t, std::size_t>> pairs;
  for (std::size_t i = 0; i < found.size(); ++i)
    for (std::size_t j = 0; j < truth.size(); ++j) {
      const double apart = distance(found[i], truth[j]);
      if (found[i].charge == truth[j].charge && apart <= kHitRadius)
        pairs.emplace_back(apart, i, j);
    }
  std::sort(pairs.begin(), pairs.end());
  std::vector<bool> taken(truth.size(), false);
  for (const auto& [apart, i, j] : pairs) {
    if (match.truth_of_found[i] >= 0 || taken[j]) continue;
    match.truth_of_found[i] = static_cast<int>(j);
    taken[j] = true;
    ++match.hits;
  }
  return match;
}

std::vector<GradedVortex> grade_vortices(std::span<const SceneVortex> vortices) {
  std::vector<GradedVortex> graded;
  for (const SceneVortex& vortex : vortices)
    graded.push_back({vortex.x, vortex.y, vortex.charge, true, true});
  std::vector<std::tuple<double, std::size_t, std::size_t>> pairs;
  for (std::size_t i = 0; i < graded.size(); ++i) {
    for (std::size_t j = i + 1; j < graded.size(); ++j) {
      const double apart = distance(graded[i], graded[j]);
      if (apart <= kIsolation) graded[i].isolated = graded[j].isolated = false;
      if (graded[i].charge != graded[j].charge && apart < kClosestRequiredPair)
        pairs.emplace_back(apart, i, j);
    }
  }
  // One pass in order of distance is enough, because removing a pair makes no other pair closer.
  std::sort(pairs.begin(), pairs.end());
  for (const auto& [apart, i, j] : pairs) {
    if (graded[i].required && graded[j].required) graded[i].required = graded[j].required = false;
  }
  return graded;
}

}  // namespace curlew
