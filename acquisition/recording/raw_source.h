// A RawSource gives frames from files that hold pixels and nothing else.
#pragma once

#include <cstdint>
#include <fstream>
#include <string>
#include <vector>

#include "acquisition/frame_source.h"

namespace curlew {

enum class RawPixel : std::uint8_t {
  kU8,
  kU16LittleEndian,
  kU16BigEndian,
};

/// Describes such files: header_bytes, then frame after frame of rows × cols pixels.
struct RawLayout {
  int rows = 0;
  int cols = 0;
  RawPixel pixel = RawPixel::kU16LittleEndian;
  std::int64_t header_bytes = 0;
};

/// Delivers the frames of one or more files. They are numbered from 0, and times are unknown (0).
class RawSource final : public FrameSource {
 public:
  /// Throws UsageError for a layout without pixels, and Failure for a file that is missing or whose
  /// length is not that of whole frames.
  RawSource(std::vector<std::string> paths, const RawLayout& layout);

  const FrameFormat& format() const override { return format_; }
  std::int64_t frame_count() const override { return frame_count_; }
  Delivery next(FrameBuffer& into) override;

 private:
  std::vector<std::string> paths_;
  RawLayout layout_;
  FrameFormat format_;
  std::int64_t frame_count_ = 0;
  std::vector<std::int64_t> frames_of_;  ///< of each file
  std::size_t next_path_ = 0;
  std::int64_t left_ = 0;  ///< frames of the open file that were not read
  std::int64_t next_sequence_ = 0;
  std::ifstream file_;
};

}  // namespace curlew
