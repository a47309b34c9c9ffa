#include "centroiding/calibration/window_layout.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace curlew {
namespace {

/// Returns the side of the widest square window that leaves neighbours apart, whichever way the
/// grid is turned.
int window_side(const LensletGrid& grid) {
  constexpr double kTolerancePx = 0.1;  // A pitch of 6 may be fitted as 5.9998.
  const double apart = std::min(std::max(std::abs(grid.p11), std::abs(grid.p21)),
                                std::max(std::abs(grid.p12), std::abs(grid.p22)));
  return std::max(static_cast<int>(std::floor(apart + kTolerancePx)), 2);
}

/// Returns the window clipped to the frame. It is empty where less than half of it is left.
Window window_at(double x, double y, int side, int frame_cols, int frame_rows) {
  const auto first = [side](double centre) {
    return static_cast<int>(std::lround(centre - 0.5 * (side - 1)));
  };
  const int x0 = std::max(first(x), 0);
  const int y0 = std::max(first(y), 0);
  const int x1 = std::min(first(x) + side, frame_cols);
  const int y1 = std::min(first(y) + side, frame_rows);
  if (x1 <= x0 || y1 <= y0 || 2 * (x1 - x0) * (y1 - y0) < side * side) return {};
  return {x0, y0, x1 - x0, y1 - y0};
}

/// Takes away what [a0, a0+an) and [b0, b0+bn), of which a comes first, share beyond one pixel.
/// Both lose half of it.
void part(int& an, int& b0, int& bn, int shared) {
  const int excess = shared - 1;
  const int from_b = excess / 2;
  an -= excess - from_b;
  b0 += from_b;
  bn -= from_b;
}

/// Parts two windows that spots off the grid bring together, along the axis on which they share
/// less.
void part_windows(Window& a, Window& b) {
  if (a.w == 0 || b.w == 0) return;
  const int in_x = std::min(a.x0 + a.w, b.x0 + b.w) - std::max(a.x0, b.x0);
  const int in_y = std::min(a.y0 + a.h, b.y0 + b.h) - std::max(a.y0, b.y0);
  if (std::min(in_x, in_y) <= 1) return;
  if (in_x <= in_y) {
    Window& left = a.x0 <= b.x0 ? a : b;
    Window& right = a.x0 <= b.x0 ? b : a;
    part(left.w, right.x0, right.w, in_x);
  } else {
    Window& upper = a.y0 <= b.y0 ? a : b;
    Window& lower = a.y0 <= b.y0 ? b : a;
    part(upper.h, lower.y0, lower.h, in_y);
  }
}

void part_neighbours(Image<Window>& windows) {
  constexpr std::array<std::array<int, 2>, 4> kSteps{{{0, 1}, {1, -1}, {1, 0}, {1, 1}}};
  for (int r = 0; r < windows.rows(); ++r) {
    for (int c = 0; c < windows.cols(); ++c) {
      for (const auto& [dr, dc] : kSteps) {
        if (windows.contains(r + dr, c + dc)) part_windows(windows(r, c), windows(r + dr, c + dc));
      }
    }
  }
}

}  // namespace

Image<Window> lay_windows(const FoundGrid& found, int frame_rows, int frame_cols) {
  Image<Window> windows(found.grid.rows, found.grid.cols);
  const int side = window_side(found.grid);
  for (std::size_t k = 0; k < found.lit.size(); ++k) {
    if (found.lit[k] == 0) continue;
    windows[k] = window_at(static_cast<double>(found.spot_x_px[k]),
                           static_cast<double>(found.spot_y_px[k]), side, frame_cols, frame_rows);
  }
  part_neighbours(windows);
  return windows;
}

}  // namespace curlew
