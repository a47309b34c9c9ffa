#include "service/truth.h"

#include <algorithm>
#include <cmath>
#include <tuple>

#include "acquisition/fits_cube.h"
#include "acquisition/recording.h"

namespace curlew {

Truth::Truth(const std::vector<std::string>& recordings) {
  std::int64_t first_frame = 0;
  for (const std::string& path : recordings) {
    if (const auto truth = read_truth(path)) {
      known_ = true;
      for (TruthVortex vortex : *truth) {
        vortex.frame += first_frame;
        vortices_.push_back(vortex);
      }
    }
    first_frame += FitsCube::open(path).frames;
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
  std::vector<std::tuple<double, std::size_t, std::size_t>> pairs;  // distance, found, truth
  for (std::size_t i = 0; i < found.size(); ++i)
    for (std::size_t j = 0; j < truth.size(); ++j) {
      const double distance = std::hypot(static_cast<double>(found[i].x) - truth[j].x,
                                         static_cast<double>(found[i].y) - truth[j].y);
      if (found[i].charge == truth[j].charge && distance <= kHitRadius)
        pairs.emplace_back(distance, i, j);
    }
  std::sort(pairs.begin(), pairs.end());
  std::vector<bool> taken(truth.size(), false);
  for (const auto& [distance, i, j] : pairs) {
    if (match.truth_of_found[i] >= 0 || taken[j]) continue;
    match.truth_of_found[i] = static_cast<int>(j);
    taken[j] = true;
    ++match.hits;
  }
  return match;
}

}  // namespace curlew
