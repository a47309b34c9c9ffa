#include "acquisition/pictures/picture_file.h"

#include <array>
#include <fstream>
#include <string_view>

#include "acquisition/pictures/npy_file.h"
#include "acquisition/pictures/png_file.h"
#include "acquisition/pictures/tiff_file.h"
#include "core/error.h"

namespace curlew {
namespace {

using namespace std::string_view_literals;

constexpr std::size_t kBeginning = 8;  // bytes

std::string beginning_of(const std::string& path) {
  std::array<char, kBeginning> bytes{};
  std::ifstream file(path, std::ios::binary);
  file.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  return {bytes.data(), static_cast<std::size_t>(file.gcount())};
}

bool is_tiff(std::string_view beginning) {
  return beginning.starts_with("II*\0"sv) || beginning.starts_with("MM\0*"sv) ||
         beginning.starts_with("II+\0"sv) || beginning.starts_with("MM\0+"sv);  // BigTIFF
}

constexpr std::string_view kPng = "\x89PNG\r\n\x1a\n"sv;
constexpr std::string_view kNpy = "\x93NUMPY"sv;

void refuse_foreign(const std::string& path, std::string_view beginning) {
  struct Foreign {
    std::string_view beginning;
    const char* name;
  };
  constexpr std::array<Foreign, 6> kForeign = {
      {{"\xff\xd8\xff"sv, "a JPEG picture"},
       {"GIF8"sv, "a GIF picture"},
       {"BM"sv, "a BMP picture"},
       {"RIFF"sv, "a RIFF film or picture"},
       {"\x89HDF"sv, "an HDF5 file"},
       {"PK\x03\x04"sv, "a zip archive, as npz files are"}}};
  for (const Foreign& foreign : kForeign) {
    if (!beginning.starts_with(foreign.beginning)) continue;
    throw Failure(path + " is " + foreign.name +
                  ", of which no frames can be read: save frames as FITS, as PNG or TIFF in 8 or "
                  "16 bits of grey, or as npy");
  }
}

}  // namespace

std::size_t bytes_of(ElementType element) {
  switch (element) {
    case ElementType::kU8:
      return 1;
    case ElementType::kI16:
    case ElementType::kU16:
      return 2;
    case ElementType::kI32:
    case ElementType::kU32:
    case ElementType::kF32:
      return 4;
    case ElementType::kF64:
      break;
  }
  return 8;
}

bool is_picture_file(const std::string& path) {
  const std::string beginning = beginning_of(path);
  if (beginning.starts_with(kPng) || beginning.starts_with(kNpy) || is_tiff(beginning)) return true;
  refuse_foreign(path, beginning);
  return false;
}

std::unique_ptr<PictureFile> open_picture_file(const std::string& path) {
  const std::string beginning = beginning_of(path);
  if (beginning.starts_with(kPng)) return open_png(path);
  if (beginning.starts_with(kNpy)) return open_npy(path);
  if (is_tiff(beginning)) return open_tiff(path);
  throw Failure(path + " is neither PNG nor TIFF nor npy");
}

void check_picture_size(const std::string& path, std::int64_t rows, std::int64_t cols) {
  constexpr std::int64_t kMaxSide = 1 << 20;
  if (rows >= 1 && cols >= 1 && rows <= kMaxSide && cols <= kMaxSide &&
      rows * cols <= kMaxPicturePixels)
    return;
  throw Failure(path + " has frames of " + std::to_string(rows) + " x " + std::to_string(cols) +
                " pixels, which no detector has: is the file damaged?");
}

}  // namespace curlew
