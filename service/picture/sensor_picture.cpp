#include "service/picture/sensor_picture.h"

#include <algorithm>
#include <cmath>

#include "centroiding/calibration/saturation_search.h"
#include "centroiding/calibration/spot_picture.h"
#include "service/picture/canvas.h"

namespace curlew {
namespace {

constexpr double kArm = 0.12;  // of a cross, in pitches

/// Returns the brightest pixel of a square round a place; NaN where it lies outside the frame.
double peak_round(const Image<float>& frame, double x, double y, double half_px) {
  double peak = std::nan("");
  for (int r = static_cast<int>(std::ceil(y - half_px)); r <= y + half_px; ++r)
    for (int c = static_cast<int>(std::ceil(x - half_px)); c <= x + half_px; ++c)
      if (frame.contains(r, c) && !(static_cast<double>(frame(r, c)) <= peak))
        peak = static_cast<double>(frame(r, c));
  return peak;
}

/// Returns the light from which a place of the grid is said to have some: a quarter of the typical
/// spot's peak, above the level between the spots.
double some_light(const Sensor& sensor, const Image<float>& reference) {
  constexpr double kPart = 0.25;
  const double half = 0.5 * sensor.grid.pitch_px();
  std::vector<float> peaks;
  for (std::size_t k = 0; k < sensor.valid.size(); ++k) {
    if (sensor.valid[k] == 0) continue;
    peaks.push_back(
        static_cast<float>(peak_round(reference, static_cast<double>(sensor.ref_x_px[k]),
                                      static_cast<double>(sensor.ref_y_px[k]), half)));
  }
  const double level = quantile({reference.begin(), reference.end()}, 0.2);
  return level + kPart * (quantile(std::move(peaks), 0.5) - level);
}

/// Draws the places of the grid that are no lenslets of the sensor.
void draw_left_out(Canvas& canvas, const Sensor& sensor, const Image<float>& reference) {
  const double pitch = sensor.grid.pitch_px();
  const double side = std::floor(pitch);
  const double light = some_light(sensor, reference);
  for (int r = 0; r < sensor.grid.rows; ++r) {
    for (int c = 0; c < sensor.grid.cols; ++c) {
      if (sensor.valid(r, c) != 0) continue;
      const auto [x, y] = sensor.grid.pixel_from_lenslet(c, r);
      const bool lit = peak_round(reference, x, y, 0.4 * pitch) > light;
      canvas.draw_window(x - 0.5 * side + 0.5, y - 0.5 * side + 0.5, side, side,
                         lit ? kRed : kSlate);
    }
  }
}

}  // namespace

void write_sensor_picture(const std::string& path, const Sensor& sensor,
                          const Image<float>& reference_adu) {
  Canvas canvas(reference_adu, sensor.grid.pitch_px());
  for (int r = 0; r < sensor.bad_pixel.rows(); ++r)
    for (int c = 0; c < sensor.bad_pixel.cols(); ++c)
      if (sensor.bad_pixel(r, c) != 0) canvas.fill_pixel(c, r, kMagenta);
  draw_left_out(canvas, sensor, reference_adu);
  const Image<std::uint8_t> saturated = find_saturated_lenslets(sensor, reference_adu);
  for (std::size_t k = 0; k < sensor.valid.size(); ++k) {
    if (sensor.valid[k] == 0) continue;
    const Window& w = sensor.window[k];
    canvas.draw_window(w.x0, w.y0, w.w, w.h, saturated[k] != 0 ? kOrange : kGreen);
    canvas.draw_cross(static_cast<double>(sensor.ref_x_px[k]),
                      static_cast<double>(sensor.ref_y_px[k]), kArm * sensor.grid.pitch_px(),
                      kYellow);
  }
  canvas.write(path);
}

std::string sensor_picture_legend(const std::string& path) {
  return path +
         ": windows are green where a spot was found (yellow cross), orange where it is saturated, "
         "red where there is light that was left out, grey where there is none; bad pixels are "
         "magenta";
}

}  // namespace curlew
