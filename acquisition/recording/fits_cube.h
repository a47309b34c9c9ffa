// A FitsCube is the image of anybody's FITS file that holds the frames, as a stack. Frames of PNG,
// TIFF and npy files are read through it too.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "acquisition/fits/fits_file.h"
#include "acquisition/pictures/picture_stack.h"
#include "acquisition/recording/frame_selection.h"
#include "core/frame.h"
#include "core/optics.h"

namespace curlew {

/// Says what 16-bit integers mean that are signed by their header. Programs that know no unsigned
/// ones lose the key BZERO, and then pixels are 32768 too low (kShifted), or take the upper half of
/// the range for negative numbers (kWrapped, 65536 too low).
enum class SignedPixels { kAsWritten, kShifted, kWrapped };

/// Holds the image HDU with the frames (primary or extension, tile-compressed or not), or several
/// that hold a frame each; find_frame_hdus tells which. An image is 2-D or 3-D; further axes of
/// length 1 do not count. The first of them stays selected in `file`.
///
/// What is read of each frame is the region that the selection names, else the one that the key
/// DATASEC names, else all. Its offset is added to that of the keys.
struct FitsCube {
  /// Opens a file, or pictures (picture_stack.h), which have no keys; their `file` is empty and
  /// only in memory. Throws Failure for whatever FitsFile::open, find_frame_hdus and
  /// FitsFile::image refuse, and if there is no frame in the image, one dimension or more than
  /// three, a frame larger than an int counts, or no such region in it.
  static FitsCube open(const std::string& path, const FrameSelection& selection = {});

  FitsFile file;
  std::unique_ptr<PictureStack> pictures{};  ///< null: the frames are in `file`
  std::vector<int> hdus{};  ///< the images, each of which has frames_per_hdu frames
  std::int64_t frames_per_hdu = 0;
  ElementType element = ElementType::kU8;
  bool has_undefined = false;                             ///< see ImageInfo
  SignedPixels signed_pixels = SignedPixels::kAsWritten;  ///< judged by some of the frames
  std::int64_t frames = 0;                                ///< of all HDUs together
  int image_rows = 0;  ///< rows and columns of the images, of which the region is a part
  int image_cols = 0;
  PixelRegion part{};    ///< the part of the image that is read
  FrameFormat region{};  ///< rows, cols, offset and binning are set, pixel type and map are not
  Optics optics{};       ///< values of the primary header, overridden by the image's
  Detector detector{};
  std::vector<std::string> notes{};  ///< whole sentences on what is read, if that was not plain

  std::int64_t frame_pixels() const { return std::int64_t{region.rows} * region.cols; }
  bool is_cut() const { return region.rows != image_rows || region.cols != image_cols; }
  /// Returns rows, columns and type, for messages: "64 x 48 pixels of 16-bit integer".
  std::string description() const;
  /// Reads one frame of region.pixels() values as signed_pixels makes them.
  void read_values(std::int64_t frame, std::span<double> into);
  /// Reads one frame of region.pixels() values as the header has them. T is as in
  /// FitsFile::read_pixels.
  template <typename T>
  void read_frame(std::int64_t frame, std::span<T> into) {
    if (pictures) {
      pictures->read(frame, part, into);
      return;
    }
    if (hdus.size() > 1) file.select(hdus[static_cast<std::size_t>(frame / frames_per_hdu)]);
    std::int64_t first = frame % frames_per_hdu * image_rows * image_cols;
    if (!is_cut()) {
      file.read_pixels(first, into);
      return;
    }
    first += std::int64_t{part.y} * image_cols + part.x;
    const auto cols = static_cast<std::size_t>(region.cols);
    for (std::size_t begin = 0; begin < into.size(); begin += cols, first += image_cols)
      file.read_pixels(first, into.subspan(begin, cols));
  }
};

}  // namespace curlew
