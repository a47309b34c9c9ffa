// A FitsCube is the first image of anybody's FITS file, as a stack of frames.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "acquisition/fits/fits_file.h"
#include "core/frame.h"
#include "core/optics.h"

namespace curlew {

/// Holds the first image HDU that has axes (primary or extension, tile-compressed or not). It is
/// 2-D or 3-D; further axes of length 1 do not count. It stays selected in `file`.
struct FitsCube {
  /// Opens a file. Throws Failure for whatever FitsFile::open and FitsFile::image refuse, and if
  /// there is no image, no frame in it, one dimension or more than three, or a frame larger than an
  /// int counts.
  static FitsCube open(const std::string& path);

  FitsFile file;
  int hdu = 0;
  ElementType element = ElementType::kU8;
  bool has_undefined = false;  ///< see ImageInfo
  std::int64_t frames = 0;
  FrameFormat region{};  ///< rows, cols, offset and binning are set, pixel type and map are not
  Optics optics{};       ///< values of the primary header, overridden by the image's
  Detector detector{};

  std::int64_t frame_pixels() const { return std::int64_t{region.rows} * region.cols; }
  /// Returns rows, columns and type, for messages: "64 x 48 pixels of 16-bit integer".
  std::string description() const;
  /// Reads one frame of region.pixels() physical values. T is as in FitsFile::read_pixels.
  template <typename T>
  void read_frame(std::int64_t frame, std::span<T> into) {
    file.read_pixels(frame * frame_pixels(), into);
  }
};

}  // namespace curlew
