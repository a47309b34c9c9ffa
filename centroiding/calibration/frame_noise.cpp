#include "centroiding/calibration/frame_noise.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "core/median.h"

namespace curlew {

FrameNoise estimate_frame_noise(const Sensor& sensor, const FrameFormat& format, FrameView frame) {
  constexpr std::size_t kMinimum = 30;       // With fewer, the median scatters by more than 20 %.
  constexpr double kMadOfGaussian = 0.6745;  // median |x| of a unit normal distribution
  const auto pixel = [&](int y, int x) {
    const std::size_t i = static_cast<std::size_t>(y) * static_cast<std::size_t>(frame.cols) +
                          static_cast<std::size_t>(x);
    const double count = frame.pixel_type == PixelType::kU8
                             ? static_cast<double>(frame.data<std::uint8_t>()[i])
                             : static_cast<double>(frame.data<std::uint16_t>()[i]);
    if (!sensor.bad_pixel.empty() && sensor.bad_pixel[i] != 0) return std::nan("");
    const double dark =
        sensor.dark_adu.empty() ? sensor.background_adu : static_cast<double>(sensor.dark_adu[i]);
    return format.zero_adu + format.scale_adu * count - dark;
  };
  std::vector<double> differences;
  std::vector<double> levels;
  for (std::size_t k = 0; k < sensor.window.size(); ++k) {
    const Window& w = sensor.window[k];
    if (sensor.valid[k] == 0 || w.w < 4 || w.h < 4) continue;
    for (const int y : {w.y0, w.y0 + w.h - 1})
      for (const int x : {w.x0, w.x0 + w.w - 2}) {
        const double difference = std::abs(pixel(y, x + 1) - pixel(y, x));
        if (!std::isfinite(difference)) continue;
        differences.push_back(difference);
        levels.push_back(pixel(y, x));
      }
  }
  if (differences.size() < kMinimum) return {};
  return {median_of(std::span(differences)) / (kMadOfGaussian * std::numbers::sqrt2),
          median_of(std::span(levels))};
}

}  // namespace curlew
