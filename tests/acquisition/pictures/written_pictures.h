// This writes PNG, TIFF and npy files as other programs do, for tests.
#pragma once

#include <png.h>
#include <tiffio.h>

#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

#include "tests/support/scratch_directory.h"

namespace curlew {

template <typename T>
void write_npy(const std::string& path, const std::string& descr, const std::string& shape,
               const std::vector<T>& values, const std::string& fortran = "False") {
  std::string header =
      "{'descr': " + descr + ", 'fortran_order': " + fortran + ", 'shape': " + shape + ", }\n";
  std::string bytes = "\x93NUMPY";
  bytes += '\1';
  bytes += '\0';
  bytes += static_cast<char>(header.size() % 256);
  bytes += static_cast<char>(header.size() / 256);
  bytes += header;
  bytes.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T));
  write_bytes(path, bytes);
}

/// Writes one PNG. format: PNG_FORMAT_GRAY and the like, of 8 bits a channel.
inline void write_png_8(const std::string& path, int rows, int cols,
                        const std::vector<std::uint8_t>& pixels,
                        png_uint_32 format = PNG_FORMAT_GRAY) {
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  image.width = static_cast<png_uint_32>(cols);
  image.height = static_cast<png_uint_32>(rows);
  image.format = format;
  png_image_write_to_file(&image, path.c_str(), 0, pixels.data(), 0, nullptr);
}

/// Writes one PNG of 16 bits of grey, or of fewer bits a pixel; then `rows_of_bytes` are packed.
inline void write_png_grey(const std::string& path, int rows, int cols, int bits,
                           const std::vector<std::vector<std::uint8_t>>& rows_of_bytes) {
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
  png_infop info = png_create_info_struct(png);
  std::FILE* file = std::fopen(path.c_str(), "wb");
  png_init_io(png, file);
  png_set_IHDR(png, info, static_cast<png_uint_32>(cols), static_cast<png_uint_32>(rows), bits,
               PNG_COLOR_TYPE_GRAY, PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT,
               PNG_FILTER_TYPE_DEFAULT);
  png_write_info(png, info);
  for (const auto& row : rows_of_bytes) png_write_row(png, row.data());
  png_write_end(png, nullptr);
  png_destroy_write_struct(&png, &info);
  std::fclose(file);
}

/// Writes 16-bit grey, which PNG has with the high byte first.
inline void write_png_16(const std::string& path, int rows, int cols,
                         const std::vector<std::uint16_t>& pixels) {
  std::vector<std::vector<std::uint8_t>> bytes;
  for (int r = 0; r < rows; ++r) {
    bytes.emplace_back();
    for (int c = 0; c < cols; ++c) {
      const std::uint16_t v = pixels[static_cast<std::size_t>(r * cols + c)];
      bytes.back().push_back(static_cast<std::uint8_t>(v >> 8U));
      bytes.back().push_back(static_cast<std::uint8_t>(v & 0xFFU));
    }
  }
  write_png_grey(path, rows, cols, 16, bytes);
}

/// Says how a TIFF is written, page by page.
struct TiffLayout {
  std::string mode = "w";  ///< "wb": big endian, "w8": BigTIFF
  std::uint16_t bits = 16;
  std::uint16_t kind = SAMPLEFORMAT_UINT;
  std::uint16_t samples = 1;
  std::uint16_t photometric = PHOTOMETRIC_MINISBLACK;
  std::uint16_t compression = COMPRESSION_NONE;
  std::uint32_t rows_of_strip = 3;
  bool tiled = false;
  std::string description{};
};

/// Writes pages of rows × cols pixels of type T, one after the other in `values`.
template <typename T>
void write_tiff(const std::string& path, int rows, int cols, const std::vector<T>& values,
                const TiffLayout& layout) {
  constexpr std::uint32_t kTile = 16;
  TIFF* tiff = TIFFOpen(path.c_str(), layout.mode.c_str());
  const auto page =
      static_cast<std::size_t>(rows) * static_cast<std::size_t>(cols) * layout.samples;
  for (std::size_t at = 0; at < values.size(); at += page) {
    TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, cols);
    TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, rows);
    TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, layout.bits);
    TIFFSetField(tiff, TIFFTAG_SAMPLEFORMAT, layout.kind);
    TIFFSetField(tiff, TIFFTAG_SAMPLESPERPIXEL, layout.samples);
    TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, layout.photometric);
    TIFFSetField(tiff, TIFFTAG_COMPRESSION, layout.compression);
    TIFFSetField(tiff, TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG);
    if (!layout.description.empty())
      TIFFSetField(tiff, TIFFTAG_IMAGEDESCRIPTION, layout.description.c_str());
    if (layout.photometric == PHOTOMETRIC_PALETTE) {
      std::vector<std::uint16_t> map(std::size_t{1} << layout.bits);
      TIFFSetField(tiff, TIFFTAG_COLORMAP, map.data(), map.data(), map.data());
    }
    const T* pixels = values.data() + at;
    if (layout.tiled) {
      TIFFSetField(tiff, TIFFTAG_TILEWIDTH, kTile);
      TIFFSetField(tiff, TIFFTAG_TILELENGTH, kTile);
      for (std::uint32_t y = 0; y < static_cast<std::uint32_t>(rows); y += kTile) {
        for (std::uint32_t x = 0; x < static_cast<std::uint32_t>(cols); x += kTile) {
          std::vector<T> tile(kTile * kTile);
          for (std::uint32_t r = 0; r < kTile && y + r < static_cast<std::uint32_t>(rows); ++r)
            for (std::uint32_t c = 0; c < kTile && x + c < static_cast<std::uint32_t>(cols); ++c)
              tile[r * kTile + c] = pixels[(y + r) * static_cast<std::uint32_t>(cols) + x + c];
          TIFFWriteTile(tiff, tile.data(), x, y, 0, 0);
        }
      }
    } else {
      TIFFSetField(tiff, TIFFTAG_ROWSPERSTRIP, layout.rows_of_strip);
      const std::size_t row = page / static_cast<std::size_t>(rows);
      for (int r = 0; r < rows; ++r) {
        std::vector<T> copy(pixels + static_cast<std::size_t>(r) * row,
                            pixels + static_cast<std::size_t>(r + 1) * row);
        TIFFWriteScanline(tiff, copy.data(), static_cast<std::uint32_t>(r), 0);
      }
    }
    TIFFWriteDirectory(tiff);
  }
  TIFFClose(tiff);
}

}  // namespace curlew
