#include "service/picture/frame_picture.h"

#include <charconv>
#include <cmath>
#include <vector>

#include "centroiding/calibration/spot_picture.h"
#include "core/error.h"
#include "service/picture/canvas.h"

namespace curlew {
namespace {

template <typename Pixel>
Image<float> counts_of(FrameView frame) {
  Image<float> image(frame.rows, frame.cols);
  for (std::size_t i = 0; i < image.size(); ++i)
    image[i] = static_cast<float>(frame.data<Pixel>()[i]);
  return image;
}

Image<float> counts_of(FrameView frame) {
  return frame.pixel_type == PixelType::kU8 ? counts_of<std::uint8_t>(frame)
                                            : counts_of<std::uint16_t>(frame);
}

Rgb colour_of(LensletState state) {
  switch (state) {
    case LensletState::kValid:
      return kGreen;
    case LensletState::kSaturated:
      return kOrange;
    case LensletState::kAtEdge:
      return kYellow;
    case LensletState::kBadPixels:
      return kMagenta;
    case LensletState::kLost:
      return kRed;
    case LensletState::kFaint:
    case LensletState::kUnlit:
      break;
  }
  return kSlate;
}

void draw_windows(Canvas& canvas, const Sensor& sensor, const Centroids& centroids) {
  for (std::size_t k = 0; k < sensor.window.size(); ++k) {
    if (centroids.state[k] == LensletState::kUnlit) continue;
    const Window& w = sensor.window[k];
    canvas.draw_window(w.x0 + static_cast<double>(centroids.moved_x_px[k]),
                       w.y0 + static_cast<double>(centroids.moved_y_px[k]), w.w, w.h,
                       colour_of(centroids.state[k]));
  }
}

void draw_displacements(Canvas& canvas, const Sensor& sensor, const Centroids& centroids) {
  constexpr double kLongest = 0.95;  // quantile
  constexpr double kLength = 0.5;    // pitches
  std::vector<float> lengths;
  const auto displacement = [&](std::size_t k) {
    return std::pair{static_cast<double>(centroids.x_px[k] - sensor.ref_x_px[k]),
                     static_cast<double>(centroids.y_px[k] - sensor.ref_y_px[k])};
  };
  for (std::size_t k = 0; k < sensor.window.size(); ++k) {
    if (centroids.state[k] != LensletState::kValid) continue;
    const auto [x, y] = displacement(k);
    lengths.push_back(static_cast<float>(std::hypot(x, y)));
  }
  const double longest = quantile(std::move(lengths), kLongest);
  if (!(longest > 0.0)) return;
  const double times = kLength * sensor.grid.pitch_px() / longest;
  for (std::size_t k = 0; k < sensor.window.size(); ++k) {
    if (centroids.state[k] != LensletState::kValid) continue;
    const auto [x, y] = displacement(k);
    const auto x0 = static_cast<double>(sensor.ref_x_px[k]);
    const auto y0 = static_cast<double>(sensor.ref_y_px[k]);
    canvas.draw_arrow(x0, y0, x0 + times * x, y0 + times * y, kYellow);
  }
}

void draw_vortices(Canvas& canvas, const LensletGrid& grid, const VortexList& vortices) {
  constexpr Rgb kWhite{255, 255, 255};
  constexpr double kRadius = 0.45;  // pitches
  constexpr double kSign = 0.2;
  const double pitch = grid.pitch_px();
  for (const Vortex& v : vortices) {
    const auto [x, y] = grid.pixel_from_lenslet(static_cast<double>(v.x), static_cast<double>(v.y));
    const Rgb colour = v.charge > 0 ? kRed : (v.charge < 0 ? kBlue : kWhite);
    for (int ring = 0; ring < 3; ++ring)
      canvas.draw_circle(x, y, kRadius * pitch - ring * 0.7 / canvas.scale(), colour);
    if (v.charge != 0) canvas.draw_line(x - kSign * pitch, y, x + kSign * pitch, y, colour);
    if (v.charge > 0) canvas.draw_line(x, y - kSign * pitch, x, y + kSign * pitch, colour);
  }
}

}  // namespace

FramePictureOptions frame_picture_options(const std::string& text) {
  FramePictureOptions options;
  if (text.empty()) return options;
  const std::size_t colon = text.find(':');
  const char* end = text.data() + std::min(colon, text.size());
  const auto [stop, error] = std::from_chars(text.data(), end, options.frame);
  if (colon == std::string::npos || error != std::errc{} || stop != end || options.frame < 0 ||
      colon + 1 == text.size())
    throw UsageError("--picture takes FRAME:FILE.png, as in 0:first.png, not '" + text + "'");
  options.path = text.substr(colon + 1);
  return options;
}

void write_frame_picture(const std::string& path, const Sensor& sensor, const FrameSlot& slot) {
  Canvas canvas(counts_of(slot.frame->view()), sensor.grid.pitch_px());
  draw_windows(canvas, sensor, slot.centroids);
  draw_displacements(canvas, sensor, slot.centroids);
  draw_vortices(canvas, sensor.grid, slot.vortices);
  canvas.write(path);
}

std::string frame_picture_legend(const FramePictureOptions& options) {
  return options.path + ": frame " + std::to_string(options.frame) +
         "; windows are green with a slope, and without one grey where faint, yellow at the "
         "window's edge, orange saturated, magenta on bad pixels, red lost; arrows are "
         "displacements, circles vortices (red +, blue -)";
}

}  // namespace curlew
