// Strips: lenslets side by side whose windows are measured together, by whole rows of pixels.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/centroids.h"
#include "core/fixed_list.h"
#include "core/image.h"

namespace curlew {

/// A Spot describes one lenslet's window. Inside the kernel all coordinates are relative to the
/// window's centre.
struct WindowSpot {
  int x0 = 0;  ///< first column; the window is w by h pixels
  int y0 = 0;
  int w = 0;
  int h = 0;
  /// These are the limits of a valid spot from the window's centre, in px. Beyond them it is
  /// kAtEdge.
  float min_x = 0;
  float max_x = 0;
  float min_y = 0;
  float max_y = 0;
  /// This is what is known before any frame: kUnlit, kBadPixels, kLost or kValid.
  LensletState state = LensletState::kUnlit;

  float centre_x() const { return static_cast<float>(x0) + 0.5F * static_cast<float>(w - 1); }
  float centre_y() const { return static_cast<float>(y0) + 0.5F * static_cast<float>(h - 1); }
};

inline constexpr int kMaxStripLenslets = 16;
inline constexpr int kMaxStripCols = 512;
inline constexpr int kMaxStripRows = 64;
inline constexpr int kMaxUnevenRows = 16;  ///< rows of a strip that only some of its windows have
/// The widest vector has so many floats. Frames narrower than two of them have no strips.
inline constexpr int kWidestVector = 16;

/// A strip holds the lenslets [first, first + n) of one lenslet row, from left to right. No two of
/// their windows share a column, and all lie at about the same height. The strip covers the
/// rectangle of pixels round them.
struct WindowStrip {
  int first = 0;
  int n = 0;
  int x0 = 0;
  int y0 = 0;
  int cols = 0;
  int rows = 0;
  // All windows have the frame's rows [core, core_end). Above and below, only some windows do.
  int core = 0;
  int core_end = 0;
  int min_width = 0;  ///< of the windows
  int max_width = 0;
};

/// Says which windows are measured in strips. Windows without neighbours at their height, and
/// those larger than a strip may be, are in none.
class WindowStrips {
 public:
  WindowStrips(int rows, int cols);  ///< of lenslets

  /// Forms the strips of these windows, which are [rows, cols] of lenslets. Never allocates.
  void place(const Image<WindowSpot>& windows, int frame_cols) noexcept;

  /// Returns the strips of lenslet row `row`, in the order of their lenslets.
  std::span<const WindowStrip> of_row(int row) const {
    const auto r = static_cast<std::size_t>(row);
    return {strips_.begin() + row_begin_[r], strips_.begin() + row_begin_[r + 1]};
  }

  /// Returns the strip that is measured after `strip`, or the last one itself.
  const WindowStrip& after(const WindowStrip& strip) const {
    return &strip + 1 == strips_.end() ? strip : *(&strip + 1);
  }

  /// These are what WindowSpot says, a list of each, so that many lenslets' values are loaded at
  /// once. They are [lenslets + kWidestVector], and mean something where a lenslet is in a strip.
  struct Lists {
    AlignedVector<float> half_width;  ///< (w − 1)/2
    AlignedVector<float> centre_x;    ///< in the frame
    AlignedVector<float> centre_y;
    AlignedVector<float> min_x, max_x, min_y, max_y;
    AlignedVector<std::int32_t> state;
  };
  const Lists& lists() const { return lists_; }

 private:
  FixedList<WindowStrip> strips_;
  std::vector<std::size_t> row_begin_;
  Lists lists_;
};

}  // namespace curlew
