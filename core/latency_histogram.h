// A LatencyHistogram has log-linear buckets, so that a percentile is right within 1/64 of itself.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>

namespace curlew {

/// Counts durations in ns. Below 128 ns buckets are exact; above, each power of two is cut into 64
/// equal buckets. record() takes constant time and allocates nothing.
class LatencyHistogram {
 public:
  void record(std::int64_t duration_ns) noexcept {
    const auto ns = static_cast<std::uint64_t>(std::max<std::int64_t>(duration_ns, 0));
    ++counts_[bucket_of(ns)];
    ++count_;
    max_ns_ = std::max(max_ns_, ns);
  }

  void merge(const LatencyHistogram& other) noexcept {
    for (std::size_t b = 0; b < counts_.size(); ++b) counts_[b] += other.counts_[b];
    count_ += other.count_;
    max_ns_ = std::max(max_ns_, other.max_ns_);
  }

  /// Returns the smallest duration, in ns, that at least `fraction` of all durations do not exceed,
  /// rounded up to the upper end of its bucket; 0 if there are none. fraction lies in [0, 1].
  std::int64_t percentile_ns(double fraction) const noexcept {
    if (count_ == 0) return 0;
    const auto wanted = std::max<std::uint64_t>(
        1, static_cast<std::uint64_t>(std::ceil(fraction * static_cast<double>(count_))));
    std::uint64_t seen = 0;
    for (std::size_t b = 0; b < counts_.size(); ++b) {
      seen += counts_[b];
      if (seen >= wanted) return static_cast<std::int64_t>(std::min(upper_end(b), max_ns_));
    }
    return max_ns();
  }
  std::int64_t max_ns() const noexcept { return static_cast<std::int64_t>(max_ns_); }
  std::uint64_t count() const noexcept { return count_; }

 private:
  static constexpr std::size_t kSubBits = 6;
  static constexpr std::size_t kSub = std::size_t{1} << kSubBits;
  static constexpr std::size_t kOctaves = 34;  // up to 2^40 ns, 18 minutes

  static std::size_t bucket_of(std::uint64_t ns) noexcept {
    if (ns < 2 * kSub) return ns;
    const auto shift = static_cast<std::size_t>(std::bit_width(ns)) - kSubBits - 1;
    return std::min(shift * kSub + (ns >> shift), kSub * (kOctaves + 1) - 1);
  }
  static std::uint64_t upper_end(std::size_t bucket) noexcept {
    if (bucket < 2 * kSub) return bucket;
    const std::size_t shift = bucket / kSub - 1;
    return ((bucket - shift * kSub + 1) << shift) - 1;
  }

  std::array<std::uint64_t, kSub*(kOctaves + 1)> counts_{};
  std::uint64_t count_ = 0;
  std::uint64_t max_ns_ = 0;
};

}  // namespace curlew
