#include "centroiding/window_strips.h"

#include <algorithm>

#include "core/as_size.h"

namespace curlew {
namespace {

// Fewer lenslets are faster one by one.
constexpr int kMinLenslets = 3;
// Pixels between two windows are read in vain.
constexpr int kMaxGap = 8;

WindowStrip strip_of(const WindowSpot& spot, int lenslet) noexcept {
  return {.first = lenslet,
          .n = 1,
          .x0 = spot.x0,
          .y0 = spot.y0,
          .cols = spot.w,
          .rows = spot.h,
          .core = spot.y0,
          .core_end = spot.y0 + spot.h,
          .min_width = spot.w,
          .max_width = spot.w};
}

bool is_measured(const WindowSpot& spot) noexcept {
  return spot.state != LensletState::kUnlit && spot.state != LensletState::kLost;
}

/// Adds the window to the right of the strip, or returns false if it does not go with it.
bool extend(WindowStrip& strip, const WindowSpot& spot) noexcept {
  const int gap = spot.x0 - (strip.x0 + strip.cols);
  const int cols = spot.x0 + spot.w - strip.x0;
  const int y0 = std::min(strip.y0, spot.y0);
  const int rows = std::max(strip.y0 + strip.rows, spot.y0 + spot.h) - y0;
  const int core = std::max(strip.core, spot.y0);
  const int core_end = std::min(strip.core_end, spot.y0 + spot.h);
  const int uneven = rows - (core_end - core);
  if (gap < 0 || gap > kMaxGap || strip.n == kMaxStripLenslets || cols > kMaxStripCols ||
      rows > kMaxStripRows || core >= core_end || uneven > std::min(rows / 3, kMaxUnevenRows))
    return false;
  ++strip.n;
  strip.cols = cols;
  strip.y0 = y0;
  strip.rows = rows;
  strip.core = core;
  strip.core_end = core_end;
  strip.min_width = std::min(strip.min_width, spot.w);
  strip.max_width = std::max(strip.max_width, spot.w);
  return true;
}

}  // namespace

WindowStrips::WindowStrips(int rows, int cols)
    : strips_(as_size(rows) * as_size(cols)), row_begin_(as_size(rows) + 1) {
  const std::size_t n = as_size(rows) * as_size(cols) + kWidestVector;
  for (AlignedVector<float>* list : {&lists_.half_width, &lists_.centre_x, &lists_.centre_y,
                                     &lists_.min_x, &lists_.max_x, &lists_.min_y, &lists_.max_y})
    list->resize(n);
  lists_.state.resize(n);
}

void WindowStrips::place(const Image<WindowSpot>& windows, int frame_cols) noexcept {
  const int cols = windows.cols();
  strips_.clear();
  for (int row = 0; row < windows.rows(); ++row) {
    row_begin_[as_size(row)] = strips_.size();
    WindowStrip strip;
    const auto finish_strip = [&] {
      if (strip.n >= kMinLenslets) strips_.push(strip);
      strip = {};
    };
    for (int k = row * cols; k < (row + 1) * cols && frame_cols >= 2 * kWidestVector; ++k) {
      const WindowSpot& spot = windows[as_size(k)];
      if (!is_measured(spot) || spot.w > kMaxStripCols || spot.h > kMaxStripRows) {
        finish_strip();
      } else if (strip.n == 0 || !extend(strip, spot)) {
        finish_strip();
        strip = strip_of(spot, k);
      }
    }
    finish_strip();
  }
  row_begin_[as_size(windows.rows())] = strips_.size();

  for (std::size_t k = 0; k < windows.size(); ++k) {
    const WindowSpot& spot = windows[k];
    lists_.half_width[k] = 0.5F * static_cast<float>(spot.w - 1);
    lists_.centre_x[k] = spot.centre_x();
    lists_.centre_y[k] = spot.centre_y();
    lists_.min_x[k] = spot.min_x;
    lists_.max_x[k] = spot.max_x;
    lists_.min_y[k] = spot.min_y;
    lists_.max_y[k] = spot.max_y;
    lists_.state[k] = static_cast<std::int32_t>(spot.state);
  }
}

}  // namespace curlew
