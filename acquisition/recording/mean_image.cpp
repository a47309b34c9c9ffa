#include "acquisition/recording/mean_image.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <span>

#include "acquisition/recording/fits_cube.h"
#include "core/error.h"

namespace curlew {

MeanImage read_mean_image(const std::string& path) {
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  FitsCube cube = FitsCube::open(path);
  const int rows = cube.region.rows;
  const int cols = cube.region.cols;
  MeanImage result{.mean = Image<double>(rows, cols),
                   .variance = Image<double>(rows, cols),
                   .frames = cube.frames,
                   .region = cube.region};
  Image<double> frame(rows, cols);
  // This is the method of Welford, Technometrics 4, 419 (1962): nothing cancels, however large the
  // bias is.
  for (std::int64_t n = 0; n < cube.frames; ++n) {
    cube.read_frame(n, std::span(frame.data(), frame.size()));
    const double weight = 1.0 / static_cast<double>(n + 1);
    for (std::size_t k = 0; k < frame.size(); ++k) {
      const double value = std::isfinite(frame[k]) ? frame[k] : kNaN;
      const double difference = value - result.mean[k];
      result.mean[k] += difference * weight;
      result.variance[k] += difference * (value - result.mean[k]);
    }
  }
  if (std::none_of(result.mean.begin(), result.mean.end(),
                   [](double value) { return std::isfinite(value); })) {
    throw Failure(path + " holds no pixel that is a finite number in all frames");
  }
  if (cube.frames == 1) {
    result.variance = Image<double>();
  } else {
    for (double& value : result.variance) value /= static_cast<double>(cube.frames - 1);
  }
  return result;
}

}  // namespace curlew
