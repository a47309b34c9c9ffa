#include "service/sensor/sensor_verdict.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

#include "centroiding/calibration/optics_check.h"
#include "centroiding/calibration/spot_picture.h"
#include "service/method_choice.h"

namespace curlew {
namespace {

constexpr double kUndersampledPx = 1.4;  // as wide as this, a spot is mostly in one pixel

std::string describe_spots(const Sensor& sensor, double width_over_diffraction) {
  const double d_px = diffraction_px(sensor.optics, sensor.grid.pitch_px());
  const double width_px = width_over_diffraction * d_px;
  const char* sampling = width_px < kUndersampledPx
                             ? "undersampled: displacements bend within a pixel, by up to a quarter"
                             : (width_px < 2.0 ? "barely sampled" : "well sampled");
  return fmt::format(
      "spots: {:.2f} times as wide as diffraction, which has {:.2f} px per lambda/w (blur of "
      "their cores {:.2f} px rms); {}",
      width_over_diffraction, d_px, sensor.spot_blur_px, sampling);
}

std::string describe_light(const Sensor& sensor) {
  const Detector& detector = sensor.detector;
  std::vector<float> electrons;
  std::vector<float> ratios;
  for (std::size_t k = 0; k < sensor.valid.size(); ++k) {
    if (sensor.valid[k] == 0) continue;
    const double light = static_cast<double>(sensor.flux_adu[k]) * detector.e_per_adu;
    const double pixels = sensor.window[k].w * sensor.window[k].h;
    electrons.push_back(static_cast<float>(light));
    ratios.push_back(static_cast<float>(
        light / std::sqrt(light + pixels * detector.read_noise_e * detector.read_noise_e)));
  }
  const double typical = quantile(ratios, 0.5);
  return fmt::format(
      "light: {:.4g} e- a lenslet above the threshold, signal-to-noise ratio {:.3g} (the dimmest "
      "twentieth {:.3g}){}",
      quantile(std::move(electrons), 0.5), typical, quantile(std::move(ratios), 0.05),
      typical < 10.0 ? ": faint, expose more" : "");
}

std::string describe_detector(const Sensor& sensor) {
  const Detector& detector = sensor.detector;
  std::string text = fmt::format("detector: ");
  if (sensor.dark_adu.empty())
    text += fmt::format("level {:.5g} ADU, ", sensor.background_adu);
  else
    text += fmt::format("level {:.5g} ADU in the dark, ",
                        quantile({sensor.dark_adu.begin(), sensor.dark_adu.end()}, 0.5));
  text += fmt::format("read noise {:.4g} ADU or {:.3g} e-, {:.4g} e- per ADU",
                      detector.read_noise_e / detector.e_per_adu, detector.read_noise_e,
                      detector.e_per_adu);
  if (!std::isnan(detector.saturation_adu))
    text += fmt::format(", saturated at {:.6g} ADU", detector.saturation_adu);
  return text;
}

std::string describe_methods(const Sensor& sensor) {
  std::string suit;
  std::string others;
  for (const DetectMethod method :
       {DetectMethod::kCirculation, DetectMethod::kWhitened, DetectMethod::kClassifier}) {
    if (const auto objection = objection_to(method, sensor))
      others += "; not " + name_of(method) + ": " + objection->reason;
    else
      suit += (suit.empty() ? "" : ", ") + name_of(method);
  }
  return "methods that suit these spots: " + suit + others;
}

}  // namespace

std::vector<std::string> sensor_verdict(const Sensor& sensor, double width_over_diffraction) {
  const auto lit = std::count(sensor.valid.begin(), sensor.valid.end(), std::uint8_t{1});
  return {describe_spots(sensor, width_over_diffraction), describe_light(sensor),
          describe_detector(sensor),
          fmt::format("lenslets: {} measured of {} in the grid; what was left out is said above",
                      lit, sensor.valid.size()),
          describe_methods(sensor)};
}

}  // namespace curlew
