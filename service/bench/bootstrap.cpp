#include "service/bench/bootstrap.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace curlew {

Interval interval_of(std::vector<double> samples, double coverage) {
  std::erase_if(samples, [](double sample) { return std::isnan(sample); });
  constexpr double kNothing = std::numeric_limits<double>::quiet_NaN();
  if (samples.empty()) return {kNothing, kNothing};
  std::sort(samples.begin(), samples.end());
  const auto at = [&](double part) {
    return samples[static_cast<std::size_t>(
        std::lround(part * static_cast<double>(samples.size() - 1)))];
  };
  return {at(0.5 * (1.0 - coverage)), at(0.5 * (1.0 + coverage))};
}

}  // namespace curlew
