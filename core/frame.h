// This file describes the frames that a camera, a recording or the simulator delivers.
#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>

#include "core/image.h"

namespace curlew {

/// The value is the number of bytes that a pixel takes.
enum class PixelType : std::uint8_t { kU8 = 1, kU16 = 2 };

/// These are the bits of FrameHeader::status and of the STATUS columns in files (docs/files.md).
enum FrameStatus : std::uint32_t {
  kFrameOk = 0,
  kFrameIncomplete = 1,
  kFrameLate = 2,
  kFrameSaturated = 4,
  kFrameGapBefore = 8,
};

/// Describes what all frames of one source have in common. Pixels store counts; a count stands for
/// zero_adu + scale_adu · count in physical ADU.
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

/// Returns how many bits a pixel takes, 8 or 16, where pixels are whole ADU as a converter gives
/// them; 0 where they were mapped from something else.
inline int converter_bits(const FrameFormat& format) {
  if (format.scale_adu != 1.0) return 0;
  return format.pixel_type == PixelType::kU8 ? 8 : 16;
}

struct FrameHeader {
  std::int64_t sequence = 0;     ///< frame number by the device's count; a gap means lost frames
  bool renumbered = false;       ///< numbering starts anew here, so no loss before it is known
  std::int64_t camera_ns = 0;    ///< time by the device's own clock; 0 if unknown
  std::int64_t received_ns = 0;  ///< UTC since 1970, for files and never for latency
  std::chrono::steady_clock::time_point received{};  ///< start of the latency
  std::uint32_t status = kFrameOk;                   ///< bits of FrameStatus
};

/// Refers to the pixels of another owner: whole rows without padding.
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

/// Owns one frame's pixels. rows_ready counts the rows that may be read: a source that delivers
/// rows early advances it, and the others set it once to format.rows.
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
