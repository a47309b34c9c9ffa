// A PictureFile is one file that programs other than ours write frames to: PNG, TIFF or npy.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "acquisition/fits/fits_file.h"

namespace curlew {

/// A frame has no more pixels than this; larger ones are refused before memory is taken.
inline constexpr std::int64_t kMaxPicturePixels = std::int64_t{1} << 28;

/// Describes the frames of a file, which all have one size and type.
struct PictureFormat {
  int rows = 0;
  int cols = 0;
  ElementType element = ElementType::kU8;
  std::int64_t frames = 1;

  std::size_t pixels() const {
    return static_cast<std::size_t>(rows) * static_cast<std::size_t>(cols);
  }
  bool operator==(const PictureFormat&) const = default;
};

/// Returns the size of a pixel.
std::size_t bytes_of(ElementType element);

class PictureFile {
 public:
  virtual ~PictureFile() = default;

  virtual const PictureFormat& format() const = 0;
  /// Reads a frame, row after row, in the machine's byte order. pixels: of format().pixels()
  /// elements. Throws Failure, which names the file.
  virtual void read(std::int64_t frame, std::span<std::byte> pixels) = 0;
};

/// Returns whether the file begins as PNG, TIFF or npy do. Throws Failure, with the remedy, for
/// files that begin as other pictures, films and archives do, from which no frames can be read.
bool is_picture_file(const std::string& path);

/// Opens a file for which is_picture_file() is true. Throws Failure, which names the file and the
/// remedy, for colours, palettes and types that are no frames, and for damaged files.
std::unique_ptr<PictureFile> open_picture_file(const std::string& path);

/// Throws Failure where the size is no frame's. The path is for the message.
void check_picture_size(const std::string& path, std::int64_t rows, std::int64_t cols);

}  // namespace curlew
