#include "acquisition/recording/raw_source.h"

#include <chrono>
#include <filesystem>
#include <utility>

#include "core/error.h"

namespace curlew {

RawSource::RawSource(std::vector<std::string> paths, const RawLayout& layout)
    : paths_(std::move(paths)), layout_(layout) {
  constexpr int kLongestSide = 65535;
  const auto side = [](int n) { return n >= 1 && n <= kLongestSide; };
  if (!side(layout.rows) || !side(layout.cols) || layout.header_bytes < 0)
    throw UsageError(
        "raw frames need 1 to 65535 rows and columns, and a header of 0 bytes or more");
  format_.rows = layout.rows;
  format_.cols = layout.cols;
  format_.pixel_type = layout.pixel == RawPixel::kU8 ? PixelType::kU8 : PixelType::kU16;
  const auto frame_bytes = static_cast<std::int64_t>(format_.bytes());
  for (const std::string& path : paths_) {
    std::error_code unreadable;
    const auto bytes = static_cast<std::int64_t>(std::filesystem::file_size(path, unreadable));
    if (unreadable) throw Failure(path + ": " + unreadable.message());
    const std::int64_t pixels = bytes - layout.header_bytes;
    if (pixels < frame_bytes || pixels % frame_bytes != 0)
      throw Failure(path + " has " + std::to_string(bytes) + " bytes, which is no header of " +
                    std::to_string(layout.header_bytes) + " and whole frames of " +
                    std::to_string(frame_bytes) + "; correct --raw, --raw-type or --raw-header");
    frames_of_.push_back(pixels / frame_bytes);
    frame_count_ += frames_of_.back();
  }
}

Delivery RawSource::next(FrameBuffer& into) {
  while (left_ == 0) {
    if (next_path_ == paths_.size()) return Delivery::kEnd;
    file_ = std::ifstream(paths_[next_path_], std::ios::binary);
    file_.seekg(layout_.header_bytes);
    left_ = frames_of_[next_path_++];
  }
  auto* bytes = reinterpret_cast<char*>(into.data());
  const std::size_t size = format_.bytes();
  if (!file_.read(bytes, static_cast<std::streamsize>(size)))
    throw Failure(paths_[next_path_ - 1] + " cannot be read to its end");
  if (layout_.pixel == RawPixel::kU16BigEndian)
    for (std::size_t i = 0; i < size; i += 2) std::swap(bytes[i], bytes[i + 1]);
  --left_;
  into.header = {.sequence = next_sequence_,
                 .renumbered = next_sequence_ == 0,
                 .received = std::chrono::steady_clock::now()};
  ++next_sequence_;
  into.rows_ready = format_.rows;
  return Delivery::kFrame;
}

}  // namespace curlew
