// This benchmark times the least-squares split of frames in which lenslets have faded or have
// weights, beside Eigen's sparse Cholesky factor, and checks its answers.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <vector>

#include "core/image.h"
#include "core/slope_field.h"
#include "service/bench/timed_rounds.h"

namespace curlew {

/// Says what is different from the full pupil with equal weights.
enum class SplitDisturbance : std::uint8_t {
  kNone,
  kOneFaded,         ///< one lenslet, anywhere
  kOnePercentFaded,  ///< of the lit lenslets, at random
  kFivePercentFaded,
  kCrossesFaded,  ///< five per cent, in crosses of five
  kWeighted,      ///< none faded; variances as of exponentially distributed flux
};
inline constexpr std::array<SplitDisturbance, 6> kSplitDisturbances = {
    SplitDisturbance::kNone,
    SplitDisturbance::kOneFaded,
    SplitDisturbance::kOnePercentFaded,
    SplitDisturbance::kFivePercentFaded,
    SplitDisturbance::kCrossesFaded,
    SplitDisturbance::kWeighted};

/// Returns "none_faded", "one_faded", "one_percent_faded", "five_percent_faded", "crosses_faded" or
/// "weighted".
const char* name_of(SplitDisturbance disturbance);

/// Returns a round pupil with a central obscuration of .28 of its diameter, as a telescope with a
/// secondary mirror has. It is [rows, cols], and 1 where a lenslet is lit.
Image<std::uint8_t> obscured_pupil(int rows, int cols);

/// Returns slopes of a smooth wavefront with noise of .3 rad a pitch, disturbed as said. The same
/// seed gives the same frame.
SlopeField disturbed_slopes(const Image<std::uint8_t>& pupil, SplitDisturbance disturbance,
                            std::uint64_t seed);

struct SplitTimes {
  SplitDisturbance disturbance = SplitDisturbance::kNone;
  RoundTimes warm;          ///< split_slopes() straight after a split of the same frame
  RoundTimes cold;          ///< split_slopes() after the plain splits have used the caches
  RoundTimes plain_float;   ///< PlainSplit<float> with a new factor for every frame
  RoundTimes plain_double;  ///< PlainSplit<double> with a new factor for every frame
  /// The sum of the pixels of a frame with 10 x 10 u16 for each lenslet, in the same rounds
  RoundTimes read;
  RoundTimes plain_kept;  ///< PlainSplit<float> with one factor for all frames; only of kNone
  int iterations = 0;     ///< the most that a frame took
  bool converged = true;  ///< whether every frame did
  /// The largest error of a curl-free slope in any frame, as a part of the frame's largest slope.
  /// The truth is PlainSplit<double> refined once.
  double worst_error = 0.0;
  double plain_float_error = 0.0;  ///< the same of PlainSplit<float>
};

struct SplitBenchmark {
  int rows = 0;
  int cols = 0;
  int lit = 0;     ///< lenslets of the pupil
  int frames = 0;  ///< how many different ones take turns
  std::vector<SplitTimes> times;
};

/// Times an obscured pupil of rows × cols lenslets. step is called after each disturbance.
SplitBenchmark time_splits(int rows, int cols, int rounds, const std::function<void()>& step);

}  // namespace curlew
