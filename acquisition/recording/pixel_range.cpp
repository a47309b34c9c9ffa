#include "acquisition/recording/pixel_range.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>

namespace curlew {
namespace {

// From this span on, rounding to whole ADU loses less than most detectors' own noise.
constexpr double kWideSpan = 4096.0;
constexpr double kStepsOfNoise = 8.0;  // The step is at most this part of the noise.
constexpr std::size_t kBins = 65536;
constexpr std::size_t kNoBin = kBins;
constexpr double kInfinity = std::numeric_limits<double>::infinity();

// A gap must be this many times as wide as the range before it.
double least_gap(double fraction_beyond) {
  if (fraction_beyond <= 0.01) return 100.0;
  return fraction_beyond <= 0.1 ? 1e4 : kInfinity;
}

}  // namespace

PixelRange::PixelRange() : bins_(kBins), differences_(kBins), min_(kInfinity), max_(-kInfinity) {}

// The leading 16 bits of a float are its sign, exponent and 7 bits of its mantissa, so that a bin
// is .8 % wide. Negative floats are turned round, as their bits sort the other way.
std::size_t PixelRange::bin_of(double value) {
  constexpr double kLargest = std::numeric_limits<float>::max();
  const auto bits =
      std::bit_cast<std::uint32_t>(static_cast<float>(std::clamp(value, -kLargest, kLargest)));
  return (bits & 0x80000000U ? ~bits : bits | 0x80000000U) >> 16;
}

void PixelRange::add_value(double value) {
  ++values_;
  min_ = std::min(min_, value);
  max_ = std::max(max_, value);
  whole_numbers_ = whole_numbers_ && value == std::trunc(value);
  Bin& bin = bins_[bin_of(value)];
  bin.min = bin.count == 0 ? value : std::min(bin.min, value);
  bin.max = bin.count == 0 ? value : std::max(bin.max, value);
  ++bin.count;
}

std::size_t PixelRange::add(const Image<double>& frame) {
  const std::int64_t before = values_;
  for (int row = 0; row < frame.rows(); ++row) {
    double left = std::numeric_limits<double>::quiet_NaN();
    for (int col = 0; col < frame.cols(); ++col) {
      const double value = frame(row, col);
      const bool finite = std::isfinite(value);
      if (finite) add_value(value);
      if (finite && std::isfinite(left)) ++differences_[bin_of(std::abs(value - left))];
      left = value;
    }
  }
  return static_cast<std::size_t>(values_ - before);
}

double PixelRange::noise() const {
  // A difference of two normal variates is below this many of their deviations in a tenth of cases.
  constexpr double kTenthPercentile = 0.12566 * std::numbers::sqrt2;
  const std::int64_t all =
      std::accumulate(differences_.begin(), differences_.end(), std::int64_t{0});
  std::int64_t below = 0;
  for (std::size_t bin = bin_of(0.0); bin < kBins; ++bin) {
    below += differences_[bin];
    if (below * 10 <= all) continue;
    const auto bits = static_cast<std::uint32_t>(bin << 16) & 0x7fffffffU;
    return static_cast<double>(std::bit_cast<float>(bits)) / kTenthPercentile;
  }
  return 0.0;
}

double PixelRange::choose_scale(const Interval& range) const {
  const double span = range.span();
  if (span <= kMaxCount && whole_numbers_) return 1.0;
  const double noise = this->noise();
  if (span <= kMaxCount && span >= kWideSpan && !(noise > 0.0 && noise < kStepsOfNoise)) return 1.0;
  const double scale = span / kMaxCount;
  // If all values are equal, or nearly, there is no scale to choose.
  return scale >= std::numeric_limits<double>::min() ? scale : 1.0;
}

// Returns the bin below which lies this fraction of the values, those of the bin `without` not
// counted; kNoBin if there are none.
std::size_t PixelRange::find_quantile(double fraction, std::size_t without) const {
  const std::int64_t counted = values_ - (without == kNoBin ? 0 : bins_[without].count);
  const double wanted = fraction * static_cast<double>(counted);
  std::int64_t below = 0;
  for (std::size_t bin = 0; bin < kBins; ++bin) {
    if (bin == without || bins_[bin].count == 0) continue;
    below += bins_[bin].count;
    if (static_cast<double>(below) > wanted) return bin;
  }
  return kNoBin;
}

PixelRange::Interval PixelRange::leave_out_outliers() const {
  std::size_t first = find_quantile(0.1, kNoBin);
  std::size_t last = find_quantile(0.9, kNoBin);
  if (first == last && bins_[first].min == bins_[first].max) {
    // Most of the image is constant, so its width says nothing; that of the rest does.
    const std::size_t constant = first;
    if (find_quantile(0.25, constant) == kNoBin) return {min_, max_};
    first = std::min(constant, find_quantile(0.25, constant));
    last = std::max(constant, find_quantile(0.75, constant));
  }
  Interval kept{bins_[first].min, bins_[last].max};
  const auto is_far = [&](double gap, std::int64_t beyond) {
    return gap >
           kept.span() * least_gap(static_cast<double>(beyond) / static_cast<double>(values_));
  };
  std::int64_t beyond = 0;
  for (std::size_t bin = last + 1; bin < kBins; ++bin) beyond += bins_[bin].count;
  for (std::size_t bin = last + 1; bin < kBins; ++bin) {
    if (bins_[bin].count == 0) continue;
    if (is_far(bins_[bin].min - kept.max, beyond)) break;
    kept.max = bins_[bin].max;
    beyond -= bins_[bin].count;
  }
  beyond = 0;
  for (std::size_t bin = 0; bin < first; ++bin) beyond += bins_[bin].count;
  for (std::size_t bin = first; bin-- > 0;) {
    if (bins_[bin].count == 0) continue;
    if (is_far(kept.min - bins_[bin].max, beyond)) break;
    kept.min = bins_[bin].min;
    beyond -= bins_[bin].count;
  }
  return kept;
}

PixelMap PixelRange::choose_map() const {
  const Interval all{min_, max_};
  const double scale = choose_scale(all);
  const double noise = this->noise();
  const bool fine = (whole_numbers_ && scale == 1.0) || scale * kStepsOfNoise <= noise;
  const Interval kept = fine ? all : leave_out_outliers();
  if (kept.min == min_ && kept.max == max_) return {min_, max_, scale, false};
  return {kept.min, kept.max, choose_scale(kept), true};
}

}  // namespace curlew
