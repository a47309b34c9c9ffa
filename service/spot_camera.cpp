#include "service/spot_camera.h"

#include <cmath>
#include <numbers>

namespace curlew {

SpotCamera spot_camera(const Sensor& sensor) {
  SpotCamera camera;
  camera.windows = Image<SpotWindow>(sensor.valid.rows(), sensor.valid.cols());
  for (std::size_t k = 0; k < camera.windows.size(); ++k) {
    if (sensor.valid[k] == 0) continue;
    const Window& window = sensor.window[k];
    camera.windows[k] = {window.x0, window.y0,          window.w,
                         window.h,  sensor.ref_x_px[k], sensor.ref_y_px[k]};
  }
  camera.pixels_per_lambda_w = 2.0 * std::numbers::pi / std::abs(sensor.optics.slope_rad_per_px());
  camera.rows_run_up = sensor.optics.mirrored;
  camera.background_adu = sensor.background_adu;
  camera.e_per_adu = sensor.detector.e_per_adu;
  camera.read_noise_e =
      std::isfinite(sensor.detector.read_noise_e) ? sensor.detector.read_noise_e : 0.0;
  if (std::isfinite(sensor.spot_blur_px))
    camera.blur_lambda_w = sensor.spot_blur_px / camera.pixels_per_lambda_w;
  const double degrees =
      sensor.optics.mirrored ? -sensor.grid.rotation_deg() : sensor.grid.rotation_deg();
  camera.rotation_rad = degrees * std::numbers::pi / 180.0;
  camera.dark_adu = sensor.dark_adu;
  camera.response = sensor.flat;
  if (!sensor.bad_pixel.empty()) {
    if (camera.response.empty())
      camera.response = Image<float>(sensor.frame_rows, sensor.frame_cols, 1.0F);
    for (std::size_t i = 0; i < sensor.bad_pixel.size(); ++i)
      if (sensor.bad_pixel[i] != 0) camera.response[i] = 0.0F;
  }
  return camera;
}

}  // namespace curlew
