// FitsFile: images.
#include <fitsio.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <string>
#include <type_traits>

#include "acquisition/fits/fits_file.h"
#include "acquisition/fits/fits_handle.h"

namespace curlew {
namespace {

constexpr int kMaxAxes = 9;
constexpr std::int64_t kBlock =
    2880;  // bytes; every part of a FITS file is so many times this long
// What working on a plane takes at least: three of it in double, and the counts.
constexpr std::int64_t kWorkingBytes = 26;
static_assert(sizeof(LONGLONG) == sizeof(std::int64_t));

fitsfile* cfits(void* file) { return static_cast<fitsfile*>(file); }

template <typename T>
constexpr int datatype() {
  if constexpr (std::is_same_v<T, std::uint8_t>) return TBYTE;
  if constexpr (std::is_same_v<T, std::int16_t>) return TSHORT;
  if constexpr (std::is_same_v<T, std::uint16_t>) return TUSHORT;
  if constexpr (std::is_same_v<T, std::int32_t>) return TINT;
  if constexpr (std::is_same_v<T, std::uint32_t>) return TUINT;
  if constexpr (std::is_same_v<T, float>) return TFLOAT;
  if constexpr (std::is_same_v<T, double>) return TDOUBLE;
}

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

// 64-bit integers and whatever else there may be are read as double.
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

// a * b, or the largest number where that overflows.
std::int64_t saturating_product(std::int64_t a, std::int64_t b) {
  std::int64_t product = 0;
  return __builtin_mul_overflow(a, b, &product) ? std::numeric_limits<std::int64_t>::max()
                                                : product;
}

std::int64_t memory_bytes() {
  return saturating_product(sysconf(_SC_PHYS_PAGES), sysconf(_SC_PAGESIZE));
}

// Bytes of the selected HDU's data unit that the file holds. cfitsio reads zeros past the end of a
// file, so nobody else notices.
std::int64_t bytes_present(fitsfile* file) {
  int status = 0;
  LONGLONG head = 0;
  LONGLONG data = 0;
  LONGLONG end = 0;
  fits_get_hduaddrll(file, &head, &data, &end, &status);
  return status == 0 ? std::max<std::int64_t>(0, file->Fptr->filesize - data) : 0;
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

  constexpr auto kHuge = std::numeric_limits<std::int64_t>::max();
  const std::int64_t element_bytes = std::abs(stored_type) / 8;
  const std::int64_t bytes = saturating_product(info.elements(), element_bytes);
  const std::int64_t plane =
      saturating_product(axes[0], naxis > 1 ? axes[1] : 1);  // elements of one plane
  if (info.elements() == kHuge || bytes == kHuge) {
    handle_->fail("promises an image of " + shape_text(info.shape) +
                  " pixels, more than any file can hold: its header is damaged");
  }
  if (saturating_product(plane, kWorkingBytes) > memory_bytes()) {
    handle_->fail("promises an image of " + shape_text(info.shape) +
                  " pixels, and one plane of it exceeds this machine's memory");
  }
  if (handle_->writing()) return info;

  if (info.compressed) {
    // Without the whole heap the tiles lead nowhere.
    const std::int64_t promised =
        saturating_product(file->Fptr->rowlength, file->Fptr->numrows) + file->Fptr->heapsize;
    std::int64_t tiles = 1;
    for (int i = 0; i < naxis; ++i) {
      const auto n = static_cast<std::size_t>(i);
      const std::int64_t tile = std::max<std::int64_t>(1, file->Fptr->tilesize[i]);
      tiles = saturating_product(tiles, (axes[n] - 1) / tile + 1);
    }
    if (promised > bytes_present(file) || tiles > file->Fptr->numrows) {
      handle_->fail("is truncated: it lacks part of its compressed image of " +
                    shape_text(info.shape) + " pixels");
    }
  } else if (const std::int64_t present = bytes_present(file); present < bytes) {
    const std::int64_t planes = info.elements() / plane;
    handle_->fail("is truncated: its header promises " + std::to_string(planes) +
                  (planes == 1 ? " frame of " : " frames of ") +
                  std::to_string(naxis > 1 ? axes[1] : 1) + " x " + std::to_string(axes[0]) +
                  " pixels, and " + std::to_string(present / (plane * element_bytes)) +
                  " whole ones are there (" + std::to_string(present) + " of " +
                  std::to_string(bytes) + " bytes)");
  } else if (present % kBlock != 0 && present < bytes / kBlock * kBlock + kBlock) {
    // cfitsio cannot read a part of a block.
    handle_->fail("is truncated: its last block has " + std::to_string(present % kBlock) + " of " +
                  std::to_string(kBlock) + " bytes, as if the file had not been closed");
  }
  return info;
}

template <typename T>
void FitsFile::read_pixels(std::int64_t first, std::span<T> into) {
  fitsfile* file = cfits(handle_->file);
  int status = 0;
  int stored_type = 0;
  fits_get_img_type(file, &stored_type, &status);
  // Only undefined integers need replacing; floats keep their own NaN and infinity. A compressed
  // float image stores NaN as an undefined integer too.
  T* undefined = nullptr;
  T nan{};
  if constexpr (std::is_floating_point_v<T>) {
    nan = std::numeric_limits<T>::quiet_NaN();
    if (stored_type > 0 || fits_is_compressed_image(file, &status) != 0) undefined = &nan;
  }
  int any_undefined = 0;  // cfitsio writes to it without asking
  fits_read_img(file, datatype<T>(), first + 1, static_cast<LONGLONG>(into.size()), undefined,
                into.data(), &any_undefined, &status);
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
  fits_write_img(cfits(handle_->file), datatype<T>(), first + 1,
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
    // The pixels may be there already, which fits_resize_img would not expect.
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
