#include "centroiding/calibration/saturation_search.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include "centroiding/calibration/sentence.h"
#include "core/error.h"

namespace curlew {

void find_saturation(Sensor& sensor, const Image<float>& reference_adu, const FoundGrid& found,
                     std::vector<std::string>& notes) {
  constexpr int kMany = 8;
  constexpr int kTimes = 3;
  if (!std::isnan(sensor.detector.saturation_adu) || !(found.noise_adu > 0.0)) return;
  std::vector<float> values;
  for (std::size_t i = 0; i < reference_adu.size(); ++i) {
    const bool bad = !sensor.bad_pixel.empty() && sensor.bad_pixel[i] != 0;
    if (!bad && std::isfinite(reference_adu[i])) values.push_back(reference_adu[i]);
  }
  if (values.empty()) return;
  std::sort(values.begin(), values.end(), std::greater<>());
  const double half = 0.5 * (found.background_adu + static_cast<double>(values.front()));
  int n_top = 0;
  int n_other = 0;
  for (std::size_t i = 0; i < values.size() && static_cast<double>(values[i]) > half;) {
    std::size_t end = i;
    while (end < values.size() && values[end] == values[i]) ++end;
    const auto n = static_cast<int>(end - i);
    if (i == 0) {
      n_top = n;
    } else {
      n_other = std::max(n_other, n);
    }
    i = end;
  }
  if (n_top < kMany || n_top < kTimes * n_other) return;
  sensor.detector.saturation_adu = static_cast<double>(values.front());
  notes.push_back(say(n_top, " pixels of the reference hold its largest value, ", values.front(),
                      " ADU, which is taken as the saturation level (--saturation-adu)"));
}

Image<std::uint8_t> find_saturated_lenslets(const Sensor& sensor,
                                            const Image<float>& reference_adu) {
  Image<std::uint8_t> saturated(sensor.window.rows(), sensor.window.cols());
  if (std::isnan(sensor.detector.saturation_adu)) return saturated;
  for (std::size_t k = 0; k < saturated.size(); ++k) {
    const Window& w = sensor.window[k];
    for (int r = w.y0; r < w.y0 + w.h; ++r) {
      for (int c = w.x0; c < w.x0 + w.w; ++c) {
        const bool bad = !sensor.bad_pixel.empty() && sensor.bad_pixel(r, c) != 0;
        if (!bad && static_cast<double>(reference_adu(r, c)) >= sensor.detector.saturation_adu)
          saturated[k] = 1;
      }
    }
  }
  return saturated;
}

void refuse_saturated(const Sensor& sensor, const Image<float>& reference_adu) {
  constexpr int kTenth = 10;
  const Image<std::uint8_t> saturated = find_saturated_lenslets(sensor, reference_adu);
  const auto n_saturated = std::count(saturated.begin(), saturated.end(), std::uint8_t{1});
  const auto n_lit = std::count_if(sensor.window.begin(), sensor.window.end(),
                                   [](const Window& w) { return w.w > 0; });
  if (n_saturated * kTenth > n_lit) {
    throw Failure(say(n_saturated, " of ", n_lit, " spots of the reference are saturated at ",
                      sensor.detector.saturation_adu, " ADU: expose it less"));
  }
}

}  // namespace curlew
