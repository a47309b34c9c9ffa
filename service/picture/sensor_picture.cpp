#include "service/picture/sensor_picture.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "centroiding/calibration/saturation_search.h"
#include "centroiding/calibration/spot_picture.h"
#include "service/picture/canvas.h"

namespace curlew {
namespace {

constexpr double kArm = 0.12;  // of a cross, in pitches

/// Returns how far the brightest pixel of a square round a place rises above the square's median;
/// NaN where all of it lies outside the frame.
double rise_round(const Image<float>& frame, double x, double y, double half_px) {
  std::vector<float> values;
  for (int r = static_cast<int>(std::ceil(y - half_px)); r <= y + half_px; ++r)
    for (int c = static_cast<int>(std::ceil(x - half_px)); c <= x + half_px; ++c)
      if (frame.contains(r, c) && std::isfinite(frame(r, c))) values.push_back(frame(r, c));
  if (values.empty()) return std::nan("");
  const auto peak = static_cast<double>(*std::max_element(values.begin(), values.end()));
  return peak - quantile(std::move(values), 0.5);
}

/// Returns what a place of the grid must rise by to be lit: a quarter of what the typical spot
/// does.
double least_rise(const Sensor& sensor, const Image<float>& reference, double half_px) {
  constexpr double kPart = 0.25;
  std::vector<float> rises;
  for (std::size_t k = 0; k < sensor.valid.size(); ++k) {
    if (sensor.valid[k] == 0) continue;
    rises.push_back(
        static_cast<float>(rise_round(reference, static_cast<double>(sensor.ref_x_px[k]),
                                      static_cast<double>(sensor.ref_y_px[k]), half_px)));
  }
  return kPart * quantile(std::move(rises), 0.5);
}

/// Draws the places of the grid that are no lenslets of the sensor.
void draw_left_out(Canvas& canvas, const Sensor& sensor, const Image<float>& reference) {
  const double pitch = sensor.grid.pitch_px();
  const double side = std::floor(pitch);
  const double half = 0.4 * pitch;
  const double light = least_rise(sensor, reference, half);
  for (int r = 0; r < sensor.grid.rows; ++r) {
    for (int c = 0; c < sensor.grid.cols; ++c) {
      if (sensor.valid(r, c) != 0) continue;
      const auto [x, y] = sensor.grid.pixel_from_lenslet(c, r);
      const bool lit = rise_round(reference, x, y, half) > light;
      canvas.draw_window(x - 0.5 * side + 0.5, y - 0.5 * side + 0.5, side, side,
                         lit ? kRed : kSlate);
    }
  }
}

}  // namespace

void write_sensor_picture(const std::string& path, const Sensor& sensor,
                          const Image<float>& reference_adu) {
  Image<float> good = reference_adu;
  for (std::size_t i = 0; i < sensor.bad_pixel.size(); ++i)
    if (sensor.bad_pixel[i] != 0) good[i] = std::nanf("");
  Canvas canvas(good, sensor.grid.pitch_px());
  for (int r = 0; r < sensor.bad_pixel.rows(); ++r)
    for (int c = 0; c < sensor.bad_pixel.cols(); ++c)
      if (sensor.bad_pixel(r, c) != 0) canvas.fill_pixel(c, r, kMagenta);
  draw_left_out(canvas, sensor, good);
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
