#include "service/daemon/frame_brightness.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

namespace curlew {
namespace {

/// Returns the median of every so-manieth pixel, of a few thousand.
template <typename Pixel>
double median(const Pixel* pixels, std::size_t n) {
  constexpr std::size_t kEnough = 4096;
  std::vector<Pixel> some;
  for (std::size_t i = 0; i < n; i += n / kEnough + 1) some.push_back(pixels[i]);
  const auto middle = some.begin() + static_cast<std::ptrdiff_t>(some.size() / 2);
  std::nth_element(some.begin(), middle, some.end());
  return static_cast<double>(*middle);
}

template <typename Pixel>
double brightness(FrameView frame, double pitch_px, double saturation) {
  constexpr double kOverNeighbours = 4.0;
  constexpr std::size_t kPassedOver = 100;
  const auto* pixels = frame.data<Pixel>();
  const auto cols = static_cast<std::size_t>(frame.cols);
  const auto rows = static_cast<std::size_t>(frame.rows);
  if (rows < 3 || cols < 3) return std::nan("");
  const double level = median(pixels, rows * cols);
  const auto side = static_cast<std::size_t>(std::max(std::lround(pitch_px), 3L));
  std::vector<double> peaks((rows / side + 1) * (cols / side + 1), 0.0);
  for (std::size_t r = 1; r + 1 < rows; ++r) {
    for (std::size_t c = 1; c + 1 < cols; ++c) {
      const Pixel* pixel = pixels + r * cols + c;
      const double value = static_cast<double>(*pixel) - level;
      double& peak = peaks[r / side * (cols / side + 1) + c / side];
      if (value <= peak) continue;
      const Pixel neighbour =
          std::max(std::max(pixel[-1], pixel[1]), std::max(*(pixel - cols), *(pixel + cols)));
      peak = std::max(peak,
                      std::min(value, kOverNeighbours * (static_cast<double>(neighbour) - level)));
    }
  }
  const std::size_t over =
      std::min(std::max(peaks.size() / kPassedOver, std::size_t{2}), peaks.size() - 1);
  std::nth_element(peaks.begin(), peaks.begin() + static_cast<std::ptrdiff_t>(over), peaks.end(),
                   std::greater<>());
  return peaks[over] / std::max(saturation - level, 1.0);
}

}  // namespace

double frame_brightness(FrameView frame, double pitch_px, double saturation_counts) {
  return frame.pixel_type == PixelType::kU16
             ? brightness<std::uint16_t>(frame, pitch_px, saturation_counts)
             : brightness<std::uint8_t>(frame, pitch_px, saturation_counts);
}

}  // namespace curlew
