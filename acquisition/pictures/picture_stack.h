// A PictureStack gives the frames of a picture file, or of many, in their order.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "acquisition/pictures/picture_file.h"
#include "acquisition/recording/frame_selection.h"

namespace curlew {

/// Returns whether a path means pictures: a PNG, TIFF or npy file, a directory, or a pattern such
/// as "frames/*.png" where there is no file of that name. Throws Failure as is_picture_file().
bool means_pictures(const std::string& path);

/// Returns the files that the path means, in the order of the numbers in their names: 2 before 10.
/// Of a directory these are the files that end in .png, .tif, .tiff or .npy. Throws Failure where
/// there is none.
std::vector<std::string> find_pictures(const std::string& path);

/// Orders names as people do, by the numbers in them.
bool comes_before(const std::string& a, const std::string& b);

class PictureStack {
 public:
  /// Throws Failure for what open_picture_file() refuses, and for files whose frames differ in
  /// size, type or number.
  explicit PictureStack(const std::string& path);

  /// `frames` counts those of all files.
  const PictureFormat& format() const { return format_; }
  std::size_t files() const { return paths_.size(); }

  /// Reads the part of a frame into as many values. T: any number; of all pixels it must be able to
  /// hold the values.
  template <typename T>
  void read(std::int64_t frame, const PixelRegion& part, std::span<T> into) {
    load(frame);
    switch (format_.element) {
      case ElementType::kU8:
        return copy<std::uint8_t>(part, into);
      case ElementType::kI16:
        return copy<std::int16_t>(part, into);
      case ElementType::kU16:
        return copy<std::uint16_t>(part, into);
      case ElementType::kI32:
        return copy<std::int32_t>(part, into);
      case ElementType::kU32:
        return copy<std::uint32_t>(part, into);
      case ElementType::kF32:
        return copy<float>(part, into);
      case ElementType::kF64:
        return copy<double>(part, into);
    }
  }

 private:
  void load(std::int64_t frame);

  template <typename From, typename T>
  void copy(const PixelRegion& part, std::span<T> into) const {
    std::size_t i = 0;
    for (int r = part.y; r < part.y + part.height; ++r) {
      const std::byte* from =
          pixels_.data() + (static_cast<std::size_t>(r) * static_cast<std::size_t>(format_.cols) +
                            static_cast<std::size_t>(part.x)) *
                               sizeof(From);
      for (int c = 0; c < part.width; ++c, from += sizeof(From)) {
        From value;
        std::memcpy(&value, from, sizeof value);
        into[i++] = static_cast<T>(value);
      }
    }
  }

  std::vector<std::string> paths_;
  PictureFormat format_;
  std::int64_t frames_of_file_ = 1;
  std::unique_ptr<PictureFile> file_;  ///< the one being read
  std::size_t file_index_ = 0;
  std::int64_t loaded_ = -1;  ///< the frame in pixels_
  std::vector<std::byte> pixels_;
};

}  // namespace curlew
