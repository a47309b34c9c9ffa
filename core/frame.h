// Frame: what a camera, a recording or the simulator delivers.
#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>

#include "core/image.h"

namespace curlew {

enum class PixelType : std::uint8_t { kU8 = 1, kU16 = 2 };  // the value is the bytes a pixel takes

/// Bits of FrameHeader::status and of the STATUS columns in files.
enum FrameStatus : std::uint32_t {
  kFrameOk = 0,
  kFrameIncomplete = 1,
  kFrameLate = 2,
  kFrameSaturated = 4,
  kFrameGapBefore = 8,
};

/// What all frames of one source have in common.
/// Counts are what is stored; physical ADU = zero_adu + scale_adu * count.
struct FrameFormat {
  int rows = 0;
  int cols = 0;
  PixelType pixel_type = PixelType::kU16;
  double scale_adu = 1.0;
  double zero_adu = 0.0;
  int offset_x_px = 0;  ///< first column on the full detector
  int offset_y_px = 0;  ///< first row on the full detector
  int binning = 1;

  std::size_t pixels() const {
    return static_cast<std::size_t>(rows) * static_cast<std::size_t>(cols);
  }
  std::size_t bytes() const { return pixels() * static_cast<std::size_t>(pixel_type); }
  bool operator==(const FrameFormat&) const = default;
};

struct FrameHeader {
  std::int64_t sequence = 0;     ///< the device's frame number; gaps are lost frames
  bool renumbered = false;       ///< numbering starts anew here: nothing was lost before
  std::int64_t camera_ns = 0;    ///< the device's own clock; 0 unknown
  std::int64_t received_ns = 0;  ///< UTC since 1970, for files; never used for latency
  std::chrono::steady_clock::time_point received{};  ///< latency is counted from here
  std::uint32_t status = kFrameOk;
};

/// Somebody else's pixels, whole rows without padding.
struct FrameView {
  const std::byte* pixels = nullptr;
  int rows = 0;
  int cols = 0;
  PixelType pixel_type = PixelType::kU16;

  template <typename T>
  const T* data() const {
    return reinterpret_cast<const T*>(pixels);
  }
};

/// Owns one frame's pixels. rows_ready counts the rows that may be read: a source that
/// delivers rows early advances it, the others set it once to format.rows.
class FrameBuffer {
 public:
  explicit FrameBuffer(const FrameFormat& format) : format_(format), pixels_(format.bytes()) {}

  const FrameFormat& format() const { return format_; }
  std::byte* data() { return pixels_.data(); }
  FrameView view() const {
    return {pixels_.data(), format_.rows, format_.cols, format_.pixel_type};
  }

  FrameHeader header;
  std::atomic<int> rows_ready{0};

 private:
  FrameFormat format_;
  AlignedVector<std::byte> pixels_;
};

}  // namespace curlew
