// This file holds what FitsFile does with images.
#include <fitsio.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <type_traits>

#include "acquisition/fits/fits_file.h"
#include "acquisition/fits/fits_handle.h"
#include "acquisition/fits/hdu_bytes.h"
#include "core/memory_limit.h"

namespace curlew {
namespace {

// A calibration works on a plane with this many bytes a pixel, measured on 4000 x 4000 floats.
constexpr std::int64_t kWorkingBytes = 48;
static_assert(sizeof(LONGLONG) == sizeof(std::int64_t));

int image_type(ElementType element) {
  switch (element) {
    case ElementType::kU8:
      return BYTE_IMG;
    case ElementType::kI16:
      return SHORT_IMG;
    case ElementType::kU16:
      return USHORT_IMG;
    case ElementType::kI32:
      return LONG_IMG;
    case ElementType::kU32:
      return ULONG_IMG;
    case ElementType::kF32:
      return FLOAT_IMG;
    case ElementType::kF64:
      break;
  }
  return DOUBLE_IMG;
}

// We read 64-bit integers, and whatever else there may be, as double.
ElementType element_type(int equivalent_type) {
  switch (equivalent_type) {
    case BYTE_IMG:
      return ElementType::kU8;
    case SBYTE_IMG:
    case SHORT_IMG:
      return ElementType::kI16;
    case USHORT_IMG:
      return ElementType::kU16;
    case LONG_IMG:
      return ElementType::kI32;
    case ULONG_IMG:
      return ElementType::kU32;
    case FLOAT_IMG:
      return ElementType::kF32;
    default:
      return ElementType::kF64;
  }
}

std::string shape_text(const std::vector<std::int64_t>& shape) {
  std::string text;
  for (const std::int64_t n : shape) text += (text.empty() ? "" : " x ") + std::to_string(n);
  return text;
}

// Returns a * b, or the largest number if that overflows.
std::int64_t saturating_product(std::int64_t a, std::int64_t b) {
  std::int64_t product = 0;
  return __builtin_mul_overflow(a, b, &product) ? std::numeric_limits<std::int64_t>::max()
                                                : product;
}

// Returns how many bytes the file holds from where the selected HDU's data begin. cfitsio reads
// zeros past the end of a file, so nobody else notices that data are missing.
std::int64_t bytes_present(fitsfile* file) {
  int status = 0;
  LONGLONG head = 0;
  LONGLONG data = 0;
  LONGLONG end = 0;
  fits_get_hduaddrll(file, &head, &data, &end, &status);
  return status == 0 ? std::max<std::int64_t>(0, file->Fptr->filesize - data) : 0;
}

// These are the sizes of an image that has pixels. A number that would overflow is the largest
// there is.
struct ImageSize {
  ImageSize(const ImageInfo& info, int stored_type)
      : elements(info.elements()),
        element_bytes(std::abs(stored_type) / 8),
        bytes(saturating_product(elements, element_bytes)),
        cols(info.shape.back()),
        rows(info.shape.size() > 1 ? info.shape[info.shape.size() - 2] : 1),
        plane(saturating_product(cols, rows)) {}

  std::int64_t elements;
  std::int64_t element_bytes;
  std::int64_t bytes;
  std::int64_t cols;
  std::int64_t rows;
  std::int64_t plane;  ///< This many elements make a plane.
};

// Returns what is wrong with a size that no file or no memory can hold, or nothing.
std::optional<std::string> find_impossible(const ImageInfo& info, const ImageSize& size) {
  constexpr auto kHuge = std::numeric_limits<std::int64_t>::max();
  if (size.elements == kHuge || size.bytes == kHuge) {
    return "promises an image of " + shape_text(info.shape) +
           " pixels, more than any file can hold: its header is damaged";
  }
  const std::int64_t needed = saturating_product(size.plane, kWorkingBytes);
  if (needed > memory_limit_bytes()) {
    return "promises an image of " + shape_text(info.shape) +
           " pixels, and one plane of it takes " + std::to_string(needed / 1'000'000) +
           " MB of memory, more than the limit of " +
           std::to_string(memory_limit_bytes() / 1'000'000) +
           " MB; CURLEW_MEMORY_MB in the environment sets another";
  }
  return std::nullopt;
}

// Returns how many tiles the selected compressed image consists of.
std::int64_t tile_count(fitsfile* file, const ImageInfo& info) {
  std::int64_t tiles = 1;
  for (std::size_t i = 0; i < info.shape.size(); ++i) {
    const std::int64_t length = info.shape[info.shape.size() - 1 - i];  // This is cfitsio's axis i.
    const std::int64_t tile = std::max<std::int64_t>(1, file->Fptr->tilesize[i]);
    tiles = saturating_product(tiles, (length - 1) / tile + 1);
  }
  return tiles;
}

// Returns what the file lacks of the selected compressed image, or nothing. A row of its table only
// says where in the heap after the table the tile is, so the heap must be there to its end.
std::optional<std::string> find_missing_tiles(fitsfile* file, const ImageInfo& info) {
  const std::int64_t promised =
      saturating_product(file->Fptr->rowlength, file->Fptr->numrows) + file->Fptr->heapsize;
  if (promised <= bytes_present(file) && tile_count(file, info) <= file->Fptr->numrows)
    return std::nullopt;
  return "is truncated: it lacks part of its compressed image of " + shape_text(info.shape) +
         " pixels";
}

// Returns what the file lacks of the selected plain image, or nothing.
std::optional<std::string> find_missing_pixels(fitsfile* file, const ImageSize& size) {
  const std::int64_t present = bytes_present(file);
  if (present < size.bytes) {
    const std::int64_t planes = size.elements / size.plane;
    return "is truncated: its header promises " + std::to_string(planes) +
           (planes == 1 ? " frame of " : " frames of ") + std::to_string(size.rows) + " x " +
           std::to_string(size.cols) + " pixels, and " +
           std::to_string(present / (size.plane * size.element_bytes)) + " whole ones are there (" +
           std::to_string(present) + " of " + std::to_string(size.bytes) + " bytes)";
  }
  // cfitsio cannot read a part of a block.
  if (present % kFitsBlock != 0 && present < size.bytes / kFitsBlock * kFitsBlock + kFitsBlock) {
    return "is truncated: its last block has " + std::to_string(present % kFitsBlock) + " of " +
           std::to_string(kFitsBlock) + " bytes, as if the file had not been closed";
  }
  return std::nullopt;
}

}  // namespace

std::int64_t ImageInfo::elements() const {
  if (shape.empty()) return 0;
  std::int64_t product = 1;
  for (const std::int64_t n : shape) product = n == 0 ? 0 : saturating_product(product, n);
  return product;
}

ImageInfo FitsFile::image() {
  fitsfile* file = cfits(handle_->file);
  if (!is_image()) handle_->fail("has a table where an image is needed");
  int status = 0;
  int stored_type = 0;
  int naxis = 0;
  std::array<LONGLONG, kMaxAxes> axes{};
  fits_get_img_paramll(file, kMaxAxes, &stored_type, &naxis, axes.data(), &status);
  int equivalent_type = 0;
  fits_get_img_equivtype(file, &equivalent_type, &status);
  handle_->check(status, "read the size of an image");
  if (naxis > kMaxAxes) {
    handle_->fail("has an image of " + std::to_string(naxis) + " dimensions, 3 are understood");
  }

  ImageInfo info;
  info.element = element_type(equivalent_type);
  info.shape.assign(axes.rend() - naxis, axes.rend());
  info.compressed = fits_is_compressed_image(file, &status) != 0;
  if (stored_type > 0) {
    info.has_undefined = key_int("BLANK").has_value() || key_int("ZBLANK").has_value();
  }
  if (info.elements() == 0) return info;

  const ImageSize size(info, stored_type);
  if (const auto problem = find_impossible(info, size)) handle_->fail(*problem);
  if (handle_->writing()) return info;
  const auto missing =
      info.compressed ? find_missing_tiles(file, info) : find_missing_pixels(file, size);
  if (missing) handle_->fail(*missing);
  return info;
}

const FitsFile::Handle::PixelPlace& FitsFile::Handle::find_pixels() {
  fitsfile* opened = cfits(file);
  int hdu = 0;
  fits_get_hdu_num(opened, &hdu);
  if (hdu == pixels.hdu && reading()) return pixels;
  PixelPlace place{.hdu = hdu};
  int status = 0;
  fits_get_img_type(opened, &place.bits, &status);
  place.compressed = fits_is_compressed_image(opened, &status) != 0;
  int naxis = 0;
  std::array<LONGLONG, kMaxAxes> axes{};
  fits_get_img_dim(opened, &naxis, &status);
  fits_get_img_sizell(opened, kMaxAxes, axes.data(), &status);
  LONGLONG data = 0;
  fits_get_hduaddrll(opened, nullptr, &data, nullptr, &status);
  check(status, "read the type of its pixels");
  place.data = data;
  place.elements = naxis > 0 ? 1 : 0;
  for (int i = 0; i < std::min(naxis, kMaxAxes); ++i)
    place.elements = saturating_product(place.elements, axes.at(static_cast<std::size_t>(i)));
  const auto number = [&](const char* key, double& value) {
    int missing = 0;
    fits_read_key(opened, TDOUBLE, key, &value, nullptr, &missing);
    if (missing != 0) fits_clear_errmsg();
  };
  number("BZERO", place.zero);
  number("BSCALE", place.scale);
  return pixels = place;
}

template <typename T>
bool FitsFile::Handle::read_plain(const PixelPlace& place, std::int64_t first, std::span<T> into) {
  constexpr bool kByte = std::is_same_v<T, std::uint8_t>;
  constexpr bool kUnsigned = std::is_same_v<T, std::uint16_t>;
  if constexpr (kByte || kUnsigned || std::is_same_v<T, std::int16_t>) {
    const auto n = static_cast<std::int64_t>(into.size());
    if (!reading() || place.compressed || place.bits != static_cast<int>(8 * sizeof(T)) ||
        place.scale != 1.0 || place.zero != (kUnsigned ? 32768.0 : 0.0) || first < 0 ||
        first > place.elements - n)
      return false;
    const std::int64_t at = place.data + first * static_cast<std::int64_t>(sizeof(T));
    if (!reader.read(source.get(), at, std::as_writable_bytes(into)))
      fail("cannot be read: it became shorter, or its disk fails");
    if constexpr (!kByte)
      order_bytes({reinterpret_cast<std::uint16_t*>(into.data()), into.size()}, kUnsigned);
    return true;
  }
  return false;
}

void FitsFile::Handle::unpack(const UnpackingProcess::Request& request, std::span<std::byte> into) {
  if (!unpacking) unpacking = std::make_unique<UnpackingProcess>(source.get());
  const UnpackingProcess::Outcome outcome = unpacking->read(request, into);
  if (outcome == UnpackingProcess::Outcome::kRead) return;
  unpacking.reset();
  switch (outcome) {
    case UnpackingProcess::Outcome::kTooLong:
      fail("is damaged: its compressed pixels cannot be unpacked within " +
           std::to_string(request.longest_ms / 1000) + " s");
    case UnpackingProcess::Outcome::kTooLarge:
      fail("has compressed pixels that take too much memory: unpack it first, with funpack");
    default:
      fail("is damaged: its compressed pixels cannot be unpacked");
  }
}

template <typename T>
void FitsFile::read_pixels(std::int64_t first, std::span<T> into) {
  const Handle::PixelPlace& place = handle_->find_pixels();
  if (handle_->read_plain(place, first, into)) return;
  // We replace only undefined integers; floats keep their own NaN and infinity. A compressed float
  // image stores NaN as an undefined integer too.
  const bool undefined_is_nan = std::is_floating_point_v<T> && (place.bits > 0 || place.compressed);
  if (place.compressed && handle_->reading()) {
    handle_->unpack(
        {.hdu = place.hdu - 1,
         .datatype = fits_datatype<T>(),
         .first = first,
         .bytes = static_cast<std::int64_t>(into.size_bytes()),
         .elements = static_cast<std::int64_t>(into.size()),
         .in_image = place.elements,
         .longest_ms = UnpackingProcess::time_for_ms(static_cast<std::int64_t>(into.size())),
         .undefined_is_nan = undefined_is_nan},
        std::as_writable_bytes(into));
    return;
  }
  int status = 0;
  T nan{};
  if constexpr (std::is_floating_point_v<T>) nan = std::numeric_limits<T>::quiet_NaN();
  int any_undefined = 0;  // cfitsio writes to it whether we want it or not.
  fits_read_img(cfits(handle_->file), fits_datatype<T>(), first + 1,
                static_cast<LONGLONG>(into.size()), undefined_is_nan ? &nan : nullptr, into.data(),
                &any_undefined, &status);
  handle_->check(status, "read its pixels");
}

void FitsFile::create_image(ElementType element, const std::vector<std::int64_t>& shape,
                            const std::string& name, const std::string& unit) {
  fitsfile* file = cfits(handle_->file);
  int status = 0;
  int hdus = 0;
  fits_get_num_hdus(file, &hdus, &status);
  if (hdus == 0 && !name.empty()) fits_create_imgll(file, BYTE_IMG, 0, nullptr, &status);
  std::vector<LONGLONG> axes(shape.rbegin(), shape.rend());
  fits_create_imgll(file, image_type(element), static_cast<int>(axes.size()), axes.data(), &status);
  handle_->check(status, "add an image");
  if (!name.empty()) write_key("EXTNAME", name);
  if (!unit.empty()) write_key("BUNIT", unit);
  // Without this cfitsio takes the image for a table once another HDU, or itself, is selected.
  fits_set_hdustruc(file, &status);
  handle_->check(status, "add an image");
}

void FitsFile::create_compressed_image(ElementType element, const std::vector<std::int64_t>& shape,
                                       const std::string& unit) {
  fitsfile* file = cfits(handle_->file);
  int status = 0;
  std::array<long, kMaxAxes> tile{};
  tile.fill(1);
  for (std::size_t i = 0; i < 2; ++i) {
    tile.at(i) = static_cast<long>(shape.at(shape.size() - 1 - i));
  }
  fits_set_compression_type(file, RICE_1, &status);
  fits_set_tile_dim(file, static_cast<int>(shape.size()), tile.data(), &status);
  handle_->check(status, "add a compressed image");
  create_image(element, shape, "", unit);
}

template <typename T>
void FitsFile::write_pixels(std::int64_t first, std::span<const T> pixels) {
  int status = 0;
  // cfitsio's parameter is not const, but it does not write to it.
  fits_write_img(cfits(handle_->file), fits_datatype<T>(), first + 1,
                 static_cast<LONGLONG>(pixels.size()), const_cast<T*>(pixels.data()), &status);
  handle_->check(status, "write its pixels");
}

void FitsFile::resize_planes(std::int64_t planes) {
  fitsfile* file = cfits(handle_->file);
  int status = 0;
  int type = 0;
  int naxis = 0;
  int selected = 0;
  int hdus = 0;
  std::array<LONGLONG, kMaxAxes> axes{};
  fits_get_img_paramll(file, kMaxAxes, &type, &naxis, axes.data(), &status);
  fits_get_img_equivtype(file, &type, &status);
  fits_get_hdu_num(file, &selected);
  fits_get_num_hdus(file, &hdus, &status);
  handle_->check(status, "read the size of an image");
  LONGLONG& slowest = axes.at(static_cast<std::size_t>(naxis - 1));
  if (slowest == planes) return;
  if (slowest < planes && selected == hdus) {
    // The pixels may be there already, and fits_resize_img would not expect them.
    const std::string key = "NAXIS" + std::to_string(naxis);
    fits_modify_key_lng(file, key.c_str(), planes, "&", &status);
    fits_set_hdustruc(file, &status);
  } else {
    slowest = planes;
    fits_resize_imgll(file, type, naxis, axes.data(), &status);
  }
  handle_->check(status, "set the number of planes");
}

#define CURLEW_PIXELS(T)                                           \
  template void FitsFile::read_pixels(std::int64_t, std::span<T>); \
  template void FitsFile::write_pixels(std::int64_t, std::span<const T>);
CURLEW_PIXELS(std::uint8_t)
CURLEW_PIXELS(std::int16_t)
CURLEW_PIXELS(std::uint16_t)
CURLEW_PIXELS(std::int32_t)
CURLEW_PIXELS(std::uint32_t)
CURLEW_PIXELS(float)
CURLEW_PIXELS(double)
#undef CURLEW_PIXELS

}  // namespace curlew
