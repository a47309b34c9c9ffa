// This is the centroid stage written plainly, in double and one pixel at a time. The kernel must
// equal it.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "centroiding/centroid.h"
#include "core/frame.h"

namespace curlew::test {

struct ReferenceSpot {
  double x_px = 0, y_px = 0, flux_adu = 0;
  double xx_px2 = 0, yy_px2 = 0, xy_px2 = 0;
  double variance_x_px2 = 0, variance_y_px2 = 0, covariance_xy_px2 = 0;
};

/// The plan must be that of the sensor, the format and the options. Its maps are taken as they are,
/// because they are rounded; pixel_codes_test.cpp says by how much.
inline ReferenceSpot reference_spot(const Sensor& sensor, const FrameFormat& format,
                                    const CentroidOptions& options, const CentroidPlan& plan,
                                    FrameView frame, const Window& window) {
  const double e_per_count = sensor.detector.e_per_adu * format.scale_adu;
  const double read_noise = sensor.detector.read_noise_e / e_per_count;
  struct Pixel {
    double x, y, light;  // `light` is in calibrated counts above the background.
  };
  std::vector<Pixel> pixels;
  double peak = 0;
  double gains = 0;
  for (int y = window.y0; y < window.y0 + window.h; ++y) {
    for (int x = window.x0; x < window.x0 + window.w; ++x) {
      if (!sensor.bad_pixel.empty() && sensor.bad_pixel(y, x) != 0) continue;
      const int i = y * frame.cols + x;
      const double count = frame.pixel_type == PixelType::kU16
                               ? static_cast<double>(frame.data<std::uint16_t>()[i])
                               : static_cast<double>(frame.data<std::uint8_t>()[i]);
      const double dark = (sensor.background_adu - format.zero_adu) / format.scale_adu;
      const double gain = plan.gain.empty() ? 1.0 : static_cast<double>(plan.gain(y, x));
      const double light = plan.gain.empty()
                               ? count - dark
                               : gain * count - (static_cast<double>(plan.offset(y, x)) -
                                                 static_cast<double>(plan.threshold));
      gains += gain;
      pixels.push_back({static_cast<double>(x), static_cast<double>(y), light});
      peak = std::max(peak, pixels.back().light);
    }
  }
  const double threshold =
      std::max({options.threshold_adu / format.scale_adu, options.threshold_noise * read_noise,
                options.threshold_relative * peak});
  const double c = threshold / e_per_count + read_noise * read_noise + 1.0 / 12.0;
  const double width = 0.73 * std::sqrt(c) + 1.3 / e_per_count;
  const double mean_gain = gains / static_cast<double>(pixels.size());

  const auto variance = [&](double v) {
    const double near = std::min(v / width, 1.0);
    return v / e_per_count + c * near * near;
  };

  double flux = 0, x = 0, y = 0, flux_variance = 0;
  for (const Pixel& p : pixels) {
    const double v = std::max(p.light - threshold, 0.0);
    flux += v;
    flux_variance += variance(v);
    x += v * p.x;
    y += v * p.y;
  }
  ReferenceSpot spot;
  spot.flux_adu = flux * format.scale_adu;
  if (flux <= 0) return spot;
  x /= flux;
  y /= flux;
  spot.x_px = x;
  spot.y_px = y;
  const double photons_part = flux / e_per_count / flux_variance;
  const double relative_variance = flux_variance * mean_gain / (flux * flux);
  const double widening = 1.0 + 12.0 * std::pow(photons_part, 4.0) / (flux * e_per_count) +
                          std::min(500.0 * std::pow(relative_variance, 3.0), 0.45);
  for (const Pixel& p : pixels) {
    const double v = std::max(p.light - threshold, 0.0);
    const double q = variance(v) * mean_gain / (flux * flux) * widening;
    spot.xx_px2 += v * (p.x - x) * (p.x - x) / flux;
    spot.yy_px2 += v * (p.y - y) * (p.y - y) / flux;
    spot.xy_px2 += v * (p.x - x) * (p.y - y) / flux;
    spot.variance_x_px2 += q * (p.x - x) * (p.x - x);
    spot.variance_y_px2 += q * (p.y - y) * (p.y - y);
    spot.covariance_xy_px2 += q * (p.x - x) * (p.y - y);
  }
  return spot;
}

}  // namespace curlew::test
