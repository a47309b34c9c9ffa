// A PixelRange finds the values that 16 bits have to hold, whatever the unit of a file is.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/image.h"

namespace curlew {

inline constexpr double kMaxCount = 65535.0;  ///< the largest that 16 bits hold

/// Says how values become counts: value = min + scale · count. What lies outside is clipped.
struct PixelMap {
  double min = 0.0;
  double max = 0.0;
  double scale = 1.0;
  bool leaves_out = false;  ///< whether far outliers lie outside

  bool holds(double value) const { return value >= min && value <= max; }
};

/// Collects the values of frames, and then chooses their map.
///
/// The map takes in all values if its step is then no problem: 1 for whole numbers, else an eighth
/// of the noise at most. If not, one flagged pixel of -1e30 may be the cause, so the values are
/// looked at from the middle outwards, and where the next value is farther away than 100 times the
/// whole range so far, all beyond it is left out, if it is no more than 1 % of the values (10 %
/// behind a gap of 10,000 ranges). Light leaves no such gap, because spots have flanks.
///
/// The noise is that of differences between neighbours in a row, by their 10th percentile, so that
/// the flanks of spots do not count.
class PixelRange {
 public:
  PixelRange();

  /// Adds a frame and returns how many of its values are finite.
  std::size_t add(const Image<double>& frame);

  double min() const { return min_; }  ///< of all finite values; +inf if there were none
  double max() const { return max_; }
  /// Returns the standard deviation of a pixel; 0 if it is not known or there is none.
  double noise() const;
  /// Needs at least one finite value, and min and max no farther apart than a double can hold.
  PixelMap choose_map() const;

 private:
  /// Holds the values whose leading bits are the same.
  struct Bin {
    std::int64_t count = 0;
    double min = 0.0;
    double max = 0.0;
  };
  struct Interval {
    double min = 0.0;
    double max = 0.0;
    double span() const { return max - min; }
  };

  static std::size_t bin_of(double value);
  void add_value(double value);
  double choose_scale(const Interval& range) const;
  std::size_t find_quantile(double fraction, std::size_t without) const;
  Interval leave_out_outliers() const;

  std::vector<Bin> bins_;                  ///< in the order of their values
  std::vector<std::int64_t> differences_;  ///< counts of differences, in the same bins
  std::int64_t values_ = 0;
  double min_;
  double max_;
  bool whole_numbers_ = true;
};

}  // namespace curlew
