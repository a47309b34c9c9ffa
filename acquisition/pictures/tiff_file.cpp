#include "acquisition/pictures/tiff_file.h"

#include <tiffio.h>

#include <algorithm>
#include <array>
#include <cstdarg>
#include <cstdio>
#include <cstring>
#include <limits>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "core/error.h"

namespace curlew {
namespace {

struct TiffDeleter {
  void operator()(TIFF* tiff) const { TIFFClose(tiff); }
};

class TiffFile final : public PictureFile {
 public:
  explicit TiffFile(std::string path) : path_(std::move(path)) {
    open();
    do {
      if (is_reduced()) continue;
      const PictureFormat page = page_format();
      if (pages_.empty()) format_ = page;
      if (page != format_) {
        throw Failure(path_ + ": page " + std::to_string(pages_.size() + 1) + " has " +
                      text_of(page) + " and the first " + text_of(format_) +
                      ": the pages of a stack must be alike");
      }
      pages_.push_back(TIFFCurrentDirOffset(tiff_.get()));
    } while (TIFFReadDirectory(tiff_.get()) != 0);
    if (error_[0] != '\0') refuse_damaged();
    if (pages_.empty()) throw Failure(path_ + " holds no picture");
    refuse_hidden_pages();
    format_.frames = static_cast<std::int64_t>(pages_.size());
  }

  const PictureFormat& format() const override { return format_; }

  void read(std::int64_t frame, std::span<std::byte> pixels) override {
    error_[0] = '\0';
    PictureFormat page;
    if (TIFFSetSubDirectory(tiff_.get(), pages_[static_cast<std::size_t>(frame)]) != 0)
      page = page_format();
    page.frames = format_.frames;
    if (page != format_) throw Failure(path_ + " has changed while it was read");
    const bool whole = TIFFIsTiled(tiff_.get()) != 0 ? read_tiles(pixels) : read_strips(pixels);
    if (!whole) refuse_damaged();
  }

 private:
  static int keep_error(TIFF*, void* into, const char*, const char* format, va_list arguments) {
    auto& error = static_cast<TiffFile*>(into)->error_;
    if (error[0] == '\0') std::vsnprintf(error.data(), error.size(), format, arguments);
    return 1;  // Nothing is left to say.
  }
  static int ignore_warning(TIFF*, void*, const char*, const char*, va_list) { return 1; }

  static std::string text_of(const PictureFormat& page) {
    return std::to_string(page.rows) + " x " + std::to_string(page.cols) + " pixels of " +
           std::to_string(8 * bytes_of(page.element)) + " bits";
  }

  void open() {
    constexpr tmsize_t kMaxAllocation = tmsize_t{8} * kMaxPicturePixels;
    TIFFOpenOptions* options = TIFFOpenOptionsAlloc();
    if (options == nullptr) throw Failure(path_ + " cannot be read: memory is short");
    TIFFOpenOptionsSetMaxSingleMemAlloc(options, kMaxAllocation);
    TIFFOpenOptionsSetErrorHandlerExtR(options, keep_error, this);
    TIFFOpenOptionsSetWarningHandlerExtR(options, ignore_warning, this);
    tiff_.reset(TIFFOpenExt(path_.c_str(), "r", options));
    TIFFOpenOptionsFree(options);
    if (!tiff_) refuse_damaged();
  }

  [[noreturn]] void refuse_damaged() const {
    throw Failure(path_ + " is a damaged TIFF: " + error_.data());
  }

  template <typename T>
  T field(std::uint32_t tag, T otherwise) const {
    T value = otherwise;
    return TIFFGetFieldDefaulted(tiff_.get(), tag, &value) != 0 ? value : otherwise;
  }

  /// Thumbnails and masks are no frames.
  bool is_reduced() const {
    return (field<std::uint32_t>(TIFFTAG_SUBFILETYPE, 0) &
            (FILETYPE_REDUCEDIMAGE | FILETYPE_MASK)) != 0;
  }

  /// Returns the format of the page at hand; refuses what is no frame.
  PictureFormat page_format() const {
    const auto samples = field<std::uint16_t>(TIFFTAG_SAMPLESPERPIXEL, 1);
    const auto bits = field<std::uint16_t>(TIFFTAG_BITSPERSAMPLE, 1);
    const auto kind = field<std::uint16_t>(TIFFTAG_SAMPLEFORMAT, SAMPLEFORMAT_UINT);
    const auto photometric = field<std::uint16_t>(TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_MINISBLACK);
    const std::string remedy = ": save it in 8 or 16 bits of grey";
    if (photometric == PHOTOMETRIC_PALETTE)
      throw Failure(path_ + " has a palette, and frames are grey" + remedy);
    if (samples != 1 || photometric > PHOTOMETRIC_MINISBLACK)
      throw Failure(path_ + " has colours or transparency, and frames are grey" + remedy);
    if (photometric == PHOTOMETRIC_MINISWHITE)
      throw Failure(path_ + " is a negative, in which 0 is white: save it with 0 as black");
    PictureFormat page;
    if (kind == SAMPLEFORMAT_UINT && bits == 8) {
      page.element = ElementType::kU8;
    } else if (kind == SAMPLEFORMAT_UINT && bits == 16) {
      page.element = ElementType::kU16;
    } else if (kind == SAMPLEFORMAT_IEEEFP && bits == 32) {
      page.element = ElementType::kF32;
    } else if (kind == SAMPLEFORMAT_IEEEFP && bits == 64) {
      page.element = ElementType::kF64;
    } else {
      throw Failure(path_ + " has " + std::to_string(bits) +
                    " bits a pixel of a kind that is not " + "read" + remedy +
                    " or as 32-bit float");
    }
    const auto rows = field<std::uint32_t>(TIFFTAG_IMAGELENGTH, 0);
    const auto cols = field<std::uint32_t>(TIFFTAG_IMAGEWIDTH, 0);
    check_picture_size(path_, rows, cols);
    page.rows = static_cast<int>(rows);
    page.cols = static_cast<int>(cols);
    return page;
  }

  /// ImageJ writes stacks of more than 4 GB as one page and a remark.
  void refuse_hidden_pages() {
    if (pages_.size() > 1 || TIFFSetSubDirectory(tiff_.get(), pages_.front()) == 0) return;
    const char* text = nullptr;
    if (TIFFGetField(tiff_.get(), TIFFTAG_IMAGEDESCRIPTION, &text) == 0 || text == nullptr) return;
    const std::string_view description(text);
    if (!description.starts_with("ImageJ=") || description.find("images=") == std::string::npos)
      return;
    throw Failure(path_ +
                  " is an ImageJ stack of which only the first page can be found: save it as a "
                  "sequence of pictures, or in parts below 4 GB");
  }

  std::size_t row_bytes() const {
    return static_cast<std::size_t>(format_.cols) * bytes_of(format_.element);
  }

  bool read_strips(std::span<std::byte> pixels) {
    const auto rows_of_strip = std::clamp<std::uint32_t>(
        field<std::uint32_t>(TIFFTAG_ROWSPERSTRIP, std::numeric_limits<std::uint32_t>::max()), 1,
        static_cast<std::uint32_t>(format_.rows));
    std::uint32_t strip = 0;
    for (std::uint32_t row = 0; row < static_cast<std::uint32_t>(format_.rows);
         row += rows_of_strip) {
      const std::size_t begin = row * row_bytes();
      const std::size_t size = std::min(rows_of_strip * row_bytes(), pixels.size() - begin);
      const tmsize_t read = TIFFReadEncodedStrip(tiff_.get(), strip++, pixels.data() + begin,
                                                 static_cast<tmsize_t>(size));
      if (read != static_cast<tmsize_t>(size)) return false;
    }
    return true;
  }

  bool read_tiles(std::span<std::byte> pixels) {
    const auto width = field<std::uint32_t>(TIFFTAG_TILEWIDTH, 0);
    const auto height = field<std::uint32_t>(TIFFTAG_TILELENGTH, 0);
    check_picture_size(path_, height, width);
    const std::size_t pixel = bytes_of(format_.element);
    std::vector<std::byte> tile(static_cast<std::size_t>(width) * height * pixel);
    const auto rows = static_cast<std::uint32_t>(format_.rows);
    const auto cols = static_cast<std::uint32_t>(format_.cols);
    for (std::uint32_t y = 0; y < rows; y += height) {
      for (std::uint32_t x = 0; x < cols; x += width) {
        const std::uint32_t index = TIFFComputeTile(tiff_.get(), x, y, 0, 0);
        if (TIFFReadEncodedTile(tiff_.get(), index, tile.data(),
                                static_cast<tmsize_t>(tile.size())) < 0)
          return false;
        const std::size_t bytes = std::min(width, cols - x) * pixel;
        for (std::uint32_t r = 0; r < std::min(height, rows - y); ++r)
          std::memcpy(pixels.data() + (y + r) * row_bytes() + x * pixel,
                      tile.data() + static_cast<std::size_t>(r) * width * pixel, bytes);
      }
    }
    return true;
  }

  std::string path_;
  std::array<char, 200> error_{};
  std::unique_ptr<TIFF, TiffDeleter> tiff_;
  PictureFormat format_;
  std::vector<std::uint64_t> pages_;  ///< offsets of the frames' directories
};

}  // namespace

std::unique_ptr<PictureFile> open_tiff(const std::string& path) {
  return std::make_unique<TiffFile>(path);
}

}  // namespace curlew
