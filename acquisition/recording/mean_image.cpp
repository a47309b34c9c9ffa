#include "acquisition/recording/mean_image.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <span>

#include "acquisition/recording/fits_cube.h"
#include "acquisition/recording/pixel_range.h"
#include "core/error.h"
#include "core/stop_request.h"

namespace curlew {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

// Integers of 8 and 16 bits have no far outliers.
bool may_have_outliers(ElementType element) {
  return element != ElementType::kU8 && element != ElementType::kI16 &&
         element != ElementType::kU16;
}

// Returns the map that FitsSource makes of these frames.
PixelMap find_map(FitsCube& cube) {
  PixelRange range;
  if (may_have_outliers(cube.element)) {
    Image<double> frame(cube.region.rows, cube.region.cols);
    for (std::int64_t n = 0; n < cube.frames; ++n) {
      refuse_if_stopped(cube.file.path());
      cube.read_values(n, std::span(frame.data(), frame.size()));
      range.add(frame);
    }
  }
  return std::isfinite(range.max() - range.min()) ? range.choose_map() : PixelMap{};
}

}  // namespace

MeanImage read_mean_image(const std::string& path, const FrameSelection& selection) {
  FitsCube cube = FitsCube::open(path, selection);
  const int rows = cube.region.rows;
  const int cols = cube.region.cols;
  MeanImage result{.mean = Image<double>(rows, cols),
                   .variance = Image<double>(rows, cols),
                   .frames = cube.frames,
                   .region = cube.region,
                   .part = cube.part,
                   .image_rows = cube.image_rows,
                   .image_cols = cube.image_cols};
  const PixelMap map = find_map(cube);
  Image<double> frame(rows, cols);
  Image<std::int64_t> outside(rows, cols);
  // This is the method of Welford, Technometrics 4, 419 (1962): nothing cancels, however large the
  // bias is.
  for (std::int64_t n = 0; n < cube.frames; ++n) {
    refuse_if_stopped(path);
    cube.read_values(n, std::span(frame.data(), frame.size()));
    const double weight = 1.0 / static_cast<double>(n + 1);
    for (std::size_t k = 0; k < frame.size(); ++k) {
      double value = std::isfinite(frame[k]) ? frame[k] : kNaN;
      if (map.leaves_out && std::isfinite(value) && !map.holds(value)) {
        value = std::clamp(value, map.min, map.max);
        ++outside[k];
      }
      const double difference = value - result.mean[k];
      result.mean[k] += difference * weight;
      result.variance[k] += difference * (value - result.mean[k]);
    }
  }
  for (std::size_t k = 0; k < frame.size(); ++k) {
    if (outside[k] == cube.frames) result.mean[k] = result.variance[k] = kNaN;
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
