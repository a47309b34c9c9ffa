#include "acquisition/pictures/png_file.h"

#include <png.h>

#include <array>
#include <bit>
#include <csetjmp>
#include <cstdio>
#include <filesystem>
#include <system_error>
#include <utility>
#include <vector>

#include "acquisition/fits/partial_path.h"
#include "core/error.h"

namespace curlew {
namespace {

/// What one reading or writing of a PNG holds. libpng reports errors by longjmp, which passes no
/// destructor, so the functions that call it have no objects of their own.
struct PngJob {
  std::FILE* file = nullptr;
  png_structp png = nullptr;
  png_infop info = nullptr;
  std::array<char, 128> error{};
  png_uint_32 rows = 0;
  png_uint_32 cols = 0;
  int bits = 0;
  int colour = 0;
};

[[noreturn]] void on_error(png_structp png, png_const_charp message) {
  auto* job = static_cast<PngJob*>(png_get_error_ptr(png));
  std::snprintf(job->error.data(), job->error.size(), "%s", message);
  png_longjmp(png, 1);
}

void on_warning(png_structp, png_const_charp) {}

/// Opens the file and libpng's structures, and closes them.
class PngReader {
 public:
  explicit PngReader(const std::string& path) {
    job_.file = std::fopen(path.c_str(), "rb");
    if (job_.file == nullptr) throw Failure(path + " cannot be opened");
    job_.png = png_create_read_struct(PNG_LIBPNG_VER_STRING, &job_, on_error, on_warning);
    if (job_.png != nullptr) job_.info = png_create_info_struct(job_.png);
    if (job_.info != nullptr) return;
    close();
    throw Failure(path + " cannot be read: memory is short");
  }
  ~PngReader() { close(); }
  PngReader(const PngReader&) = delete;
  PngReader& operator=(const PngReader&) = delete;

  PngJob& job() { return job_; }

 private:
  void close() {
    png_destroy_read_struct(&job_.png, &job_.info, nullptr);
    if (job_.file != nullptr) std::fclose(std::exchange(job_.file, nullptr));
  }

  PngJob job_;
};

bool read_header(PngJob& job) {
  constexpr png_uint_32 kMaxSide = 1 << 20;
  constexpr png_alloc_size_t kMaxChunk = 8 << 20;
  if (setjmp(png_jmpbuf(job.png)) != 0) return false;
  png_init_io(job.png, job.file);
  png_set_user_limits(job.png, kMaxSide, kMaxSide);
  png_set_chunk_malloc_max(job.png, kMaxChunk);
  png_read_info(job.png, job.info);
  job.rows = png_get_image_height(job.png, job.info);
  job.cols = png_get_image_width(job.png, job.info);
  job.bits = png_get_bit_depth(job.png, job.info);
  job.colour = png_get_color_type(job.png, job.info);
  return true;
}

bool read_rows(PngJob& job, png_bytepp rows) {
  if (setjmp(png_jmpbuf(job.png)) != 0) return false;
  if (job.bits == 16 && std::endian::native == std::endian::little) png_set_swap(job.png);
  png_set_interlace_handling(job.png);
  png_read_update_info(job.png, job.info);
  png_read_image(job.png, rows);
  png_read_end(job.png, nullptr);
  return true;
}

bool write_all(PngJob& job, png_bytepp rows) {
  constexpr int kBits = 8;
  if (setjmp(png_jmpbuf(job.png)) != 0) return false;
  png_init_io(job.png, job.file);
  png_set_IHDR(job.png, job.info, job.cols, job.rows, kBits, PNG_COLOR_TYPE_RGB, PNG_INTERLACE_NONE,
               PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  png_write_info(job.png, job.info);
  png_write_image(job.png, rows);
  png_write_end(job.png, nullptr);
  return true;
}

[[noreturn]] void refuse_damaged(const std::string& path, const PngJob& job) {
  throw Failure(path + " is a damaged PNG: " + job.error.data());
}

PictureFormat read_format(const std::string& path, PngJob& job) {
  if (!read_header(job)) refuse_damaged(path, job);
  if (job.colour != PNG_COLOR_TYPE_GRAY) {
    const char* what = job.colour == PNG_COLOR_TYPE_PALETTE      ? "a palette"
                       : job.colour == PNG_COLOR_TYPE_GRAY_ALPHA ? "transparency"
                                                                 : "colours";
    throw Failure(path + " has " + what + ", and frames are grey: save it in 8 or 16 bits of grey");
  }
  if (job.bits < 8) {
    throw Failure(path + " has " + std::to_string(job.bits) +
                  " bits a pixel: save it in 8 or 16 bits of grey");
  }
  check_picture_size(path, job.rows, job.cols);
  return {static_cast<int>(job.rows), static_cast<int>(job.cols),
          job.bits == 16 ? ElementType::kU16 : ElementType::kU8, 1};
}

class PngFile final : public PictureFile {
 public:
  explicit PngFile(const std::string& path) : path_(path) {
    PngReader reader(path);
    format_ = read_format(path, reader.job());
  }

  const PictureFormat& format() const override { return format_; }

  void read(std::int64_t, std::span<std::byte> pixels) override {
    PngReader reader(path_);
    if (read_format(path_, reader.job()) != format_)
      throw Failure(path_ + " has changed while it was read");
    const std::size_t row_bytes =
        static_cast<std::size_t>(format_.cols) * bytes_of(format_.element);
    std::vector<png_bytep> rows;
    rows.reserve(static_cast<std::size_t>(format_.rows));
    for (int r = 0; r < format_.rows; ++r)
      rows.push_back(reinterpret_cast<png_bytep>(pixels.data()) +
                     static_cast<std::size_t>(r) * row_bytes);
    if (!read_rows(reader.job(), rows.data())) refuse_damaged(path_, reader.job());
  }

 private:
  std::string path_;
  PictureFormat format_;
};

/// Returns libpng's or the system's complaint; empty if the picture is on disk.
std::string write_picture(const std::string& path, const Image<Rgb>& picture) {
  static_assert(sizeof(Rgb) == 3);
  PngJob job;
  job.rows = static_cast<png_uint_32>(picture.rows());
  job.cols = static_cast<png_uint_32>(picture.cols());
  job.file = std::fopen(path.c_str(), "wb");
  if (job.file == nullptr) return "is the folder missing?";
  std::vector<png_bytep> rows;
  rows.reserve(static_cast<std::size_t>(picture.rows()));
  for (int r = 0; r < picture.rows(); ++r)  // libpng only reads them
    rows.push_back(const_cast<png_bytep>(reinterpret_cast<png_const_bytep>(&picture(r, 0))));
  job.png = png_create_write_struct(PNG_LIBPNG_VER_STRING, &job, on_error, on_warning);
  if (job.png != nullptr) job.info = png_create_info_struct(job.png);
  const bool written = job.info != nullptr && write_all(job, rows.data());
  png_destroy_write_struct(&job.png, &job.info);
  const bool closed = std::fclose(job.file) == 0;
  if (!written) return job.error.data();
  return closed ? "" : "is the disk full?";
}

}  // namespace

std::unique_ptr<PictureFile> open_png(const std::string& path) {
  return std::make_unique<PngFile>(path);
}

void write_png(const std::string& path, const Image<Rgb>& picture) {
  const std::string target = target_of(path);
  const std::string partial = partial_path(target);
  std::string why = write_picture(partial, picture);
  std::error_code error;
  if (why.empty()) {
    std::filesystem::rename(partial, target, error);
    if (error) why = error.message();
  }
  if (why.empty()) return;
  std::filesystem::remove(partial, error);
  throw Failure(path + " cannot be written: " + why);
}

}  // namespace curlew
