#include "service/picture/canvas.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "centroiding/calibration/spot_picture.h"

namespace curlew {
namespace {

constexpr int kLeastPitch = 24;  // px of the picture
constexpr int kLongestSide = 8192;

int scale_for(const Image<float>& frame, double pitch_px) {
  const int wanted = static_cast<int>(std::ceil(kLeastPitch / std::max(pitch_px, 1.0)));
  const int possible = kLongestSide / std::max({frame.rows(), frame.cols(), 1});
  return std::max(1, std::min(wanted, possible));
}

}  // namespace

Canvas::Canvas(const Image<float>& frame, double pitch_px)
    : scale_(scale_for(frame, pitch_px)), picture_(frame.rows() * scale_, frame.cols() * scale_) {
  constexpr double kDark = 0.05;
  constexpr double kBright = 0.998;
  std::vector<float> values;
  for (const float v : frame)
    if (std::isfinite(v)) values.push_back(v);
  const double low = quantile(values, kDark);
  const double high = quantile(std::move(values), kBright);
  const double range = high > low ? high - low : 1.0;
  for (int r = 0; r < frame.rows(); ++r) {
    for (int c = 0; c < frame.cols(); ++c) {
      const double light =
          std::isfinite(frame(r, c)) ? (static_cast<double>(frame(r, c)) - low) / range : 0.0;
      const auto grey = static_cast<std::uint8_t>(255.0 * std::sqrt(std::clamp(light, 0.0, 1.0)));
      fill_pixel(c, r, {grey, grey, grey});
    }
  }
}

void Canvas::fill_pixel(int x, int y, Rgb colour) {
  for (int i = y * scale_; i < (y + 1) * scale_; ++i)
    for (int j = x * scale_; j < (x + 1) * scale_; ++j)
      if (picture_.contains(i, j)) picture_(i, j) = colour;
}

/// Places are those of the frame, and the middle of its first pixel is at half a square.
void Canvas::dot(double x, double y, Rgb colour) {
  constexpr double kRounding = 1e-6;  // of places at the very edge of a pixel
  const double j = std::floor((x + 0.5) * scale_ + kRounding);
  const double i = std::floor((y + 0.5) * scale_ + kRounding);
  if (i < 0.0 || j < 0.0 || i >= picture_.rows() || j >= picture_.cols()) return;
  picture_(static_cast<int>(i), static_cast<int>(j)) = colour;
}

void Canvas::draw_line(double x0, double y0, double x1, double y1, Rgb colour) {
  const double length = std::max(std::abs(x1 - x0), std::abs(y1 - y0)) * scale_;
  if (!std::isfinite(length) || length > 2.0 * kLongestSide) return;
  const int steps = std::max(1, static_cast<int>(std::ceil(length)));
  for (int i = 0; i <= steps; ++i) {
    const double t = static_cast<double>(i) / steps;
    dot(x0 + t * (x1 - x0), y0 + t * (y1 - y0), colour);
  }
}

void Canvas::draw_window(double x0, double y0, double w, double h, Rgb colour) {
  const double last = 1.0 / scale_;  // The outline lies inside the window's own pixels.
  const double left = x0 - 0.5;
  const double top = y0 - 0.5;
  const double right = x0 + w - 0.5 - last;
  const double bottom = y0 + h - 0.5 - last;
  draw_line(left, top, right, top, colour);
  draw_line(left, bottom, right, bottom, colour);
  draw_line(left, top, left, bottom, colour);
  draw_line(right, top, right, bottom, colour);
}

void Canvas::draw_cross(double x, double y, double arm_px, Rgb colour) {
  draw_line(x - arm_px, y, x + arm_px, y, colour);
  draw_line(x, y - arm_px, x, y + arm_px, colour);
}

void Canvas::draw_circle(double x, double y, double radius_px, Rgb colour) {
  constexpr int kSides = 48;
  const auto at = [&](int side) {
    const double angle = 2.0 * std::numbers::pi * side / kSides;
    return std::pair{x + radius_px * std::cos(angle), y + radius_px * std::sin(angle)};
  };
  for (int side = 0; side < kSides; ++side) {
    const auto [x0, y0] = at(side);
    const auto [x1, y1] = at(side + 1);
    draw_line(x0, y0, x1, y1, colour);
  }
}

void Canvas::draw_arrow(double x0, double y0, double x1, double y1, Rgb colour) {
  constexpr double kHead = 0.3;  // of the arrow
  draw_line(x0, y0, x1, y1, colour);
  const double dx = kHead * (x1 - x0);
  const double dy = kHead * (y1 - y0);
  draw_line(x1, y1, x1 - dx - 0.5 * dy, y1 - dy + 0.5 * dx, colour);
  draw_line(x1, y1, x1 - dx + 0.5 * dy, y1 - dy - 0.5 * dx, colour);
}

}  // namespace curlew
