// Counts the marked pixels of any rectangle, in few bytes.
#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>

#include "core/image.h"

namespace curlew {

/// Holds a bit for each pixel of a frame. A word holds a tile of eight by eight pixels, so that a
/// window of ten by ten takes at most nine words, and all bits fit into the processor's caches.
class PixelCounter {
 public:
  PixelCounter() = default;
  PixelCounter(int frame_rows, int frame_cols)
      : tiles_((frame_rows + kSide - 1) / kSide, (frame_cols + kSide - 1) / kSide) {}

  bool empty() const { return tiles_.empty(); }
  void mark(int row, int col) {
    tiles_(row / kSide, col / kSide) |= std::uint64_t{1} << (row % kSide * kSide + col % kSide);
  }

  /// Returns how many pixels are marked in the w by h pixels from (x0, y0), which lie in the frame.
  int count(int x0, int y0, int w, int h) const noexcept {
    const int x1 = x0 + w - 1, y1 = y0 + h - 1;
    int n = 0;
    for (int r = y0 / kSide; r <= y1 / kSide; ++r) {
      // A tile's row is a byte; these are the rows and the columns of the tile that are meant.
      const std::uint64_t rows = bits_between(std::max(y0 - r * kSide, 0) * kSide,
                                              std::min(y1 - r * kSide, kSide - 1) * kSide + 7);
      for (int c = x0 / kSide; c <= x1 / kSide; ++c) {
        const std::uint64_t tile = tiles_(r, c) & rows;
        if (tile == 0) continue;
        const std::uint64_t cols = kEveryRow * bits_between(std::max(x0 - c * kSide, 0),
                                                            std::min(x1 - c * kSide, kSide - 1));
        n += std::popcount(tile & cols);
      }
    }
    return n;
  }

 private:
  static constexpr int kSide = 8;
  static constexpr std::uint64_t kEveryRow = 0x0101010101010101;

  /// Returns a word in which the bits from `first` to `last` are set.
  static std::uint64_t bits_between(int first, int last) {
    return (~std::uint64_t{0} << first) & (~std::uint64_t{0} >> (63 - last));
  }

  Image<std::uint64_t> tiles_;
};

}  // namespace curlew
