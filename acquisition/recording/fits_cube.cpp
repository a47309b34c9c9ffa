#include "acquisition/recording/fits_cube.h"

#include <algorithm>
#include <cstdint>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "acquisition/recording/frame_hdus.h"
#include "acquisition/recording/recording_keys.h"
#include "core/error.h"

namespace curlew {
namespace {

std::string type_text(ElementType element) {
  switch (element) {
    case ElementType::kU8:
      return "unsigned 8-bit integer";
    case ElementType::kI16:
      return "16-bit integer";
    case ElementType::kU16:
      return "unsigned 16-bit integer";
    case ElementType::kI32:
      return "32-bit integer";
    case ElementType::kU32:
      return "unsigned 32-bit integer";
    case ElementType::kF32:
      return "32-bit float";
    case ElementType::kF64:
      break;
  }
  return "64-bit float";
}

// Sets the size of the images and the number of frames in each.
void set_size(FitsCube& cube, const ImageInfo& info) {
  const std::string& path = cube.file.path();
  const std::size_t axes = info.shape.size();
  if (axes < 2) throw Failure(path + " holds a one-dimensional image, frames are needed");
  const std::int64_t rows = info.shape[axes - 2];
  const std::int64_t cols = info.shape[axes - 1];
  cube.frames_per_hdu = 1;
  for (std::size_t i = 0; i + 2 < axes; ++i) {
    if (cube.frames_per_hdu > 1 && info.shape[i] > 1) {
      throw Failure(path + " holds an image of more than three dimensions, frames are needed");
    }
    cube.frames_per_hdu *= info.shape[i];
  }
  if (info.elements() == 0)
    throw Failure(path + " holds no frame: its image has an axis of length 0");
  if (rows > std::numeric_limits<int>::max() || cols > std::numeric_limits<int>::max()) {
    throw Failure(path + " holds frames of " + std::to_string(rows) + " x " + std::to_string(cols) +
                  " pixels, more than a detector has");
  }
  cube.image_rows = static_cast<int>(rows);
  cube.image_cols = static_cast<int>(cols);
  cube.frames = cube.frames_per_hdu * static_cast<std::int64_t>(cube.hdus.size());
}

bool is_inside(const FitsCube& cube, const PixelRegion& part) {
  return part.x + part.width <= cube.image_cols && part.y + part.height <= cube.image_rows;
}

// Returns the part of the image that the header names as the one with light; nullopt if it names
// none that can be read. DATASEC counts from 1.
std::optional<PixelRegion> find_data_section(FitsCube& cube) {
  const std::optional<std::string> text = cube.file.key_string("DATASEC");
  if (!text || text->empty()) return std::nullopt;
  const std::optional<PixelRegion> part = parse_section(*text);
  if (!part || !is_inside(cube, *part)) {
    cube.notes.push_back(cube.file.path() + ": the key DATASEC is " + *text +
                         ", which is no part of the image, so all of it is read.");
    return std::nullopt;
  }
  if (part->width == cube.image_cols && part->height == cube.image_rows) return std::nullopt;
  cube.notes.push_back(cube.file.path() + ": of each frame " + region_text(*part) +
                       " are read, as the key DATASEC says; --region reads another part.");
  return part;
}

void set_region(FitsCube& cube, const std::optional<PixelRegion>& wanted) {
  if (wanted && !is_inside(cube, *wanted)) {
    throw Failure(cube.file.path() + " has frames of " + std::to_string(cube.image_cols) +
                  " columns and " + std::to_string(cube.image_rows) + " rows, and the region is " +
                  region_text(*wanted));
  }
  const std::optional<PixelRegion> part = wanted ? wanted : find_data_section(cube);
  cube.part = part.value_or(PixelRegion{0, 0, cube.image_cols, cube.image_rows});
  cube.region.rows = cube.part.height;
  cube.region.cols = cube.part.width;
  cube.region.offset_x_px += cube.part.x * cube.region.binning;
  cube.region.offset_y_px += cube.part.y * cube.region.binning;
}

/// Counts how often each 16-bit integer occurs in some frames of a cube.
class IntegerCounts {
 public:
  explicit IntegerCounts(FitsCube& cube) : counts_(65536) {
    constexpr std::int64_t kFrames = 8;
    std::vector<std::int16_t> pixels(static_cast<std::size_t>(cube.frame_pixels()));
    const std::int64_t step = std::max<std::int64_t>(1, cube.frames / kFrames);
    for (std::int64_t n = 0; n < cube.frames; n += step) {
      cube.read_frame(n, std::span(pixels));
      for (const std::int16_t pixel : pixels) ++counts_[static_cast<std::size_t>(pixel + 32768)];
      all_ += cube.frame_pixels();
    }
  }

  int median() const {
    std::int64_t below = 0;
    std::size_t i = 0;
    for (; i + 1 < counts_.size(); ++i) {
      below += counts_[i];
      if (2 * below > all_) break;
    }
    return static_cast<int>(i) - 32768;
  }
  /// Returns how many different integers from `first` to `last` occur.
  std::int64_t different(int first, int last) const {
    return std::count_if(counts_.begin() + (first + 32768), counts_.begin() + (last + 32769),
                         [](std::int64_t count) { return count > 0; });
  }

 private:
  std::vector<std::int64_t> counts_;
  std::int64_t all_ = 0;
};

// Whatever was subtracted from an image, half of its pixels are not thousands below zero. And light
// that is bright enough to wrap passes both ends of the range, where a flag is one value only.
SignedPixels judge_signed_pixels(FitsCube& cube) {
  constexpr int kFarBelow = -4096;
  constexpr int kEnd = 4096;  // This is what we call near the ends of the range.
  constexpr std::int64_t kMany = 8;
  const IntegerCounts counts(cube);
  if (counts.median() < kFarBelow) return SignedPixels::kShifted;
  return counts.different(-32767, -32768 + kEnd) >= kMany &&
                 counts.different(32767 - kEnd, 32766) >= kMany
             ? SignedPixels::kWrapped
             : SignedPixels::kAsWritten;
}

void set_signed_pixels(FitsCube& cube) {
  if (cube.element != ElementType::kI16) return;
  cube.signed_pixels = judge_signed_pixels(cube);
  if (cube.signed_pixels == SignedPixels::kAsWritten) return;
  const bool shifted = cube.signed_pixels == SignedPixels::kShifted;
  cube.notes.push_back(
      cube.file.path() + ": the signed 16-bit pixels " +
      (shifted ? "lie far below zero" : "jump between the ends of their range") +
      ", as unsigned ones do that lost their key BZERO; they are read as unsigned: "
      "ADU = pixel + " +
      (shifted ? "32768." : "65536 where it is negative."));
}

FitsCube open_pictures(const std::string& path, const FrameSelection& selection) {
  if (!selection.hdu.empty())
    throw UsageError(path + " is no FITS file: leave out the image's name or number (--hdu)");
  FitsCube cube{.file = FitsFile::create_in_memory(path)};
  cube.file.create_image(ElementType::kU8, {});
  cube.pictures = std::make_unique<PictureStack>(path);
  const PictureFormat& format = cube.pictures->format();
  cube.hdus = {0};
  cube.frames = cube.frames_per_hdu = format.frames;
  cube.element = format.element;
  cube.image_rows = format.rows;
  cube.image_cols = format.cols;
  set_region(cube, selection.region);
  set_signed_pixels(cube);
  if (cube.pictures->files() > 1)
    cube.notes.push_back(path + ": " + std::to_string(cube.pictures->files()) +
                         " files are read as frames, in the order of the numbers in their names.");
  return cube;
}

}  // namespace

FitsCube FitsCube::open(const std::string& path, const FrameSelection& selection) {
  if (means_pictures(path)) return open_pictures(path, selection);
  FitsCube cube{.file = FitsFile::open(path)};
  read_optics(cube.file, cube.optics);
  read_detector(cube.file, cube.detector);
  read_region(cube.file, cube.region);

  FrameHdus found = find_frame_hdus(cube.file, selection);
  if (found.hdus.front() != 0) {
    read_optics(cube.file, cube.optics);
    read_detector(cube.file, cube.detector);
    read_region(cube.file, cube.region);
  }
  cube.hdus = std::move(found.hdus);
  cube.element = found.image.element;
  cube.has_undefined = found.image.has_undefined;
  if (!found.note.empty()) cube.notes.push_back(std::move(found.note));
  set_size(cube, found.image);
  set_region(cube, selection.region);
  set_signed_pixels(cube);
  return cube;
}

void FitsCube::read_values(std::int64_t frame, std::span<double> into) {
  read_frame(frame, into);
  if (signed_pixels == SignedPixels::kShifted)
    for (double& value : into) value += 32768.0;
  if (signed_pixels == SignedPixels::kWrapped)
    for (double& value : into) value += value < 0.0 ? 65536.0 : 0.0;
}

std::string FitsCube::description() const {
  return std::to_string(region.rows) + " x " + std::to_string(region.cols) + " pixels of " +
         type_text(element);
}

}  // namespace curlew
