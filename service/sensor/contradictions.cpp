#include "service/sensor/contradictions.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

#include "centroiding/calibration/frame_noise.h"
#include "service/sensor/optics_comparison.h"

namespace curlew {

std::vector<std::string> contradictions(const Sensor& sensor, const FitsSource& source,
                                        const std::string& recording,
                                        const FrameSelection& selection) {
  constexpr double kMuchNoisier = 1.5;
  std::vector<std::string> notes;
  const double e_per_adu = source.detector().e_per_adu;
  if (std::abs(e_per_adu - sensor.detector.e_per_adu) > 0.01 * e_per_adu)
    notes.push_back(
        fmt::format("{} has {:.4g} e- per ADU, the sensor file {:.4g}: if the sensor "
                    "file is wrong, calibrate again with --e-per-adu",
                    recording, e_per_adu, sensor.detector.e_per_adu));
  const int bits = source.detector().bit_depth;
  if (bits != 0 && sensor.detector.bit_depth != 0 && bits != sensor.detector.bit_depth)
    notes.push_back(fmt::format(
        "{} has {} bits, the sensor file {}: levels and saturation are those of the sensor file, "
        "so calibrate with frames of the same pixel format",
        recording, bits, sensor.detector.bit_depth));
  const std::string differing = differing_optics(source.optics(), sensor.optics);
  if (!differing.empty())
    notes.push_back(
        fmt::format("{} was taken with other optics than the sensor file says ({}): slopes are "
                    "those of the sensor file",
                    recording, differing));
  FitsSource first({recording}, selection);
  FrameBuffer frame(first.format());
  if (first.next(frame) != Delivery::kFrame) return notes;
  const FrameNoise seen = estimate_frame_noise(sensor, first.format(), frame.view());
  // It adds photon noise, and its gradients add differences between pixels.
  const double light = std::max(seen.light_adu, 0.0);
  const double read_noise = sensor.detector.read_noise_e / sensor.detector.e_per_adu;
  const double known =
      std::sqrt(read_noise * read_noise + light / sensor.detector.e_per_adu + light * light +
                first.format().scale_adu * first.format().scale_adu / 12.0);
  if (seen.noise_adu > kMuchNoisier * known)
    notes.push_back(fmt::format(
        "{} has {:.4g} ADU of noise between the spots, the sensor file knows of {:.4g}: thresholds "
        "follow the frames, but the reference spots were measured at a lower one and may lie "
        "elsewhere; calibrate again with --read-noise-e {:.3g}",
        recording, seen.noise_adu, known, seen.noise_adu * sensor.detector.e_per_adu));
  return notes;
}

}  // namespace curlew
