#include "acquisition/recording/fits_cube.h"

#include <limits>
#include <utility>
#include <vector>

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

// Selects the first image with axes, and returns which HDU it is and what it holds.
std::pair<int, ImageInfo> find_image(FitsFile& file) {
  for (int hdu = 0; hdu == 0 || file.try_select(hdu); ++hdu) {
    if (!file.is_image()) continue;
    ImageInfo info = file.image();
    if (!info.shape.empty()) return {hdu, std::move(info)};
  }
  throw Failure(file.path() + " holds no image, neither in the primary nor in an extension");
}

}  // namespace

FitsCube FitsCube::open(const std::string& path) {
  FitsCube cube{.file = FitsFile::open(path)};
  read_optics(cube.file, cube.optics);
  read_detector(cube.file, cube.detector);
  read_region(cube.file, cube.region);

  const auto [hdu, info] = find_image(cube.file);
  if (hdu != 0) {
    read_optics(cube.file, cube.optics);
    read_detector(cube.file, cube.detector);
    read_region(cube.file, cube.region);
  }
  cube.hdu = hdu;
  cube.element = info.element;
  cube.has_undefined = info.has_undefined;

  const std::size_t axes = info.shape.size();
  if (axes < 2) throw Failure(path + " holds a one-dimensional image, frames are needed");
  const std::int64_t rows = info.shape[axes - 2];
  const std::int64_t cols = info.shape[axes - 1];
  cube.frames = 1;
  for (std::size_t i = 0; i + 2 < axes; ++i) {
    if (cube.frames > 1 && info.shape[i] > 1) {
      throw Failure(path + " holds an image of more than three dimensions, frames are needed");
    }
    cube.frames *= info.shape[i];
  }
  if (info.elements() == 0)
    throw Failure(path + " holds no frame: its image has an axis of length 0");
  if (rows > std::numeric_limits<int>::max() || cols > std::numeric_limits<int>::max()) {
    throw Failure(path + " holds frames of " + std::to_string(rows) + " x " + std::to_string(cols) +
                  " pixels, more than a detector has");
  }
  cube.region.rows = static_cast<int>(rows);
  cube.region.cols = static_cast<int>(cols);
  return cube;
}

std::string FitsCube::description() const {
  return std::to_string(region.rows) + " x " + std::to_string(region.cols) + " pixels of " +
         type_text(element);
}

}  // namespace curlew
