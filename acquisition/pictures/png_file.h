// This file declares what is read from and written to PNG, by libpng.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "acquisition/pictures/picture_file.h"
#include "core/image.h"

namespace curlew {

struct Rgb {
  std::uint8_t red = 0;
  std::uint8_t green = 0;
  std::uint8_t blue = 0;
  bool operator==(const Rgb&) const = default;
};

/// Opens a PNG of 8 or 16 bits of grey as one frame. Throws Failure for any other, and for a
/// damaged one.
std::unique_ptr<PictureFile> open_png(const std::string& path);

/// Writes a coloured picture, of at least one pixel. It appears under its name when it is complete.
/// Throws Failure, which names the file.
void write_png(const std::string& path, const Image<Rgb>& picture);

}  // namespace curlew
