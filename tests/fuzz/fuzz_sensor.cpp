// Sensor files: one that is read has finite numbers and windows on the detector.
#include <cmath>

#include "service/sensor/sensor_file.h"
#include "tests/fuzz/fuzz_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  using namespace curlew;
  const FuzzFile file(bytes, size);
  refuse_or([&] {
    const Sensor sensor = read_sensor(file.path());
    for (std::size_t k = 0; k < sensor.valid.size(); ++k) {
      if (sensor.valid[k] == 0) continue;
      const Window& window = sensor.window[k];
      if (!std::isfinite(sensor.ref_x_px[k]) || !std::isfinite(sensor.gain_y[k]) || window.x0 < 0 ||
          window.x0 + window.w > sensor.frame_cols)
        __builtin_trap();
    }
  });
  return 0;
}
