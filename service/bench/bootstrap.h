// The bootstrap tells how far a figure might have come out otherwise, from frames drawn with
// replacement.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "acquisition/simulator/random_stream.h"

namespace curlew {

/// The seed of all benchmarks. So figures of the same frames can be compared sample by sample.
inline constexpr std::uint64_t kBootstrapSeed = 20070401;

/// Calls use(i) for each of n frames that are drawn from n frames by the seed and the sample's
/// number.
template <typename Use>
void draw_frames(std::size_t n, std::uint64_t seed, int sample, Use use) {
  RandomStream random(seed, static_cast<std::uint64_t>(sample));
  for (std::size_t i = 0; i < n; ++i)
    use(static_cast<std::size_t>(static_cast<double>(n) * random.uniform()));
}

struct Interval {
  double low = 0.0;
  double high = 0.0;
};

/// Returns the interval that holds the middle `coverage` of the samples of one figure. NaNs are
/// left out; the interval is NaN if nothing is left.
Interval interval_of(std::vector<double> samples, double coverage = 0.95);

}  // namespace curlew
