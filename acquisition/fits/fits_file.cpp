// This file holds how FitsFile opens, commits, finds HDUs and words its errors.
#include "acquisition/fits/fits_file.h"

#include <fitsio.h>

#include <array>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <system_error>
#include <utility>

#include "acquisition/fits/fits_handle.h"
#include "acquisition/fits/partial_path.h"
#include "core/error.h"

namespace curlew {
namespace {

namespace fs = std::filesystem;

// cfitsio skips leading blanks and expands `~`; an absolute path has neither. Longer names than
// this do not fit its buffers.
constexpr std::size_t kLongestPath = 1000;

std::string literal_path(const std::string& path) {
  std::string absolute = fs::absolute(path).string();
  if (absolute.size() > kLongestPath) {
    throw Failure(path + " cannot be used: the name is longer than cfitsio allows (" +
                  std::to_string(kLongestPath) + " bytes)");
  }
  return absolute;
}

// A FITS file begins with SIMPLE. Files of gzip and compress, which cfitsio opens as well, begin
// with the other bytes.
bool begins_like_fits(const std::array<char, 6>& head) {
  return std::memcmp(head.data(), "SIMPLE", 6) == 0 ||
         std::memcmp(head.data(), "\x1f\x8b", 2) == 0 ||
         std::memcmp(head.data(), "\x1f\x9d", 2) == 0;
}

fitsfile* cfits(void* file) { return static_cast<fitsfile*>(file); }

}  // namespace

FitsFile::Handle::~Handle() {
  if (file != nullptr) {
    int status = 0;
    fits_close_file(cfits(file), &status);
    fits_clear_errmsg();
  }
  if (writing()) {
    std::error_code ignored;
    fs::remove(partial, ignored);
  }
  std::free(memory);  // cfitsio made it grow by realloc.
}

void FitsFile::Handle::fail(const std::string& what) const { throw Failure(path + " " + what); }

void FitsFile::Handle::check(int status, const std::string& doing) const {
  if (status == 0) return;
  fits_clear_errmsg();
  std::array<char, FLEN_STATUS> text{};
  fits_get_errstatus(status, text.data());
  switch (status) {
    case WRITE_ERROR:
    case FILE_NOT_CLOSED:
      fail("cannot be written: disk full?");
    case END_OF_FILE:
    case READ_ERROR:
      if (writing()) fail("cannot be written: disk full?");
      fail("is truncated or damaged: cannot " + doing);
    case KEY_NO_EXIST:
    case COL_NOT_FOUND:
    case BAD_HDU_NUM:
      fail("does not have what is needed: cannot " + doing + " (" + text.data() + ")");
    default:
      fail("cannot be used: cannot " + doing + " (" + text.data() + ")");
  }
}

FitsFile::FitsFile(std::unique_ptr<Handle> handle) : handle_(std::move(handle)) {}
FitsFile::FitsFile(FitsFile&&) noexcept = default;
FitsFile& FitsFile::operator=(FitsFile&&) noexcept = default;
FitsFile::~FitsFile() = default;

const std::string& FitsFile::path() const { return handle_->path; }

FitsFile FitsFile::open(const std::string& path) {
  auto handle = std::make_unique<Handle>();
  handle->path = path;
  std::error_code error;
  const fs::file_status what = fs::status(path, error);
  if (what.type() == fs::file_type::not_found) handle->fail("does not exist");
  if (error) handle->fail("cannot be read: " + error.message());
  if (fs::is_directory(what)) handle->fail("is a directory, not a FITS file");
  if (!fs::is_regular_file(what)) handle->fail("is not a regular file");
  if (fs::file_size(path, error) == 0 && !error) handle->fail("is empty");

  std::array<char, 6> head{};
  errno = 0;
  std::ifstream stream(path, std::ios::binary);
  if (!stream) {
    handle->fail("cannot be read: " + std::error_code(errno, std::generic_category()).message());
  }
  stream.read(head.data(), static_cast<std::streamsize>(head.size()));
  if (!begins_like_fits(head)) handle->fail("is not a FITS file");
  stream.close();

  int status = 0;
  fitsfile* file = nullptr;
  fits_open_diskfile(&file, literal_path(path).c_str(), READONLY, &status);
  if (status != 0) {
    std::array<char, FLEN_STATUS> text{};
    fits_get_errstatus(status, text.data());
    fits_clear_errmsg();
    handle->fail(std::string("is not a valid FITS file: its header is damaged or cut off (") +
                 text.data() + ")");
  }
  handle->file = file;
  return FitsFile(std::move(handle));
}

FitsFile FitsFile::create(const std::string& path) {
  auto handle = std::make_unique<Handle>();
  handle->path = path;
  std::error_code error;
  if (path.empty()) throw Failure("cannot write a file without a name");
  handle->target = replaceable_target(path);
  const fs::path folder = fs::absolute(path).parent_path();
  if (!fs::is_directory(folder, error)) {
    handle->fail("cannot be written: the directory " + folder.string() + " does not exist");
  }
  const std::string partial = literal_path(partial_path(handle->target));

  int status = 0;
  fitsfile* file = nullptr;
  errno = 0;
  fits_create_diskfile(&file, partial.c_str(), &status);
  if (status != 0) {
    const std::string why = std::error_code(errno, std::generic_category()).message();
    fits_clear_errmsg();
    handle->fail("cannot be written: " + why);
  }
  handle->file = file;
  handle->partial = partial;
  return FitsFile(std::move(handle));
}

void FitsFile::commit() {
  Handle& h = *handle_;
  if (!h.writing() || h.file == nullptr) h.fail("is not being written");
  int status = 0;
  fits_close_file(cfits(std::exchange(h.file, nullptr)), &status);
  std::error_code error;
  if (status == 0) fs::rename(h.partial, h.target, error);
  if (status != 0 || error) {
    std::error_code ignored;
    fs::remove(h.partial, ignored);
  }
  h.check(status, "write to disk");
  if (error) h.fail("cannot be written: " + error.message());
  h.partial.clear();
}

int FitsFile::hdu_count() {
  int status = 0;
  int count = 0;
  fits_get_num_hdus(cfits(handle_->file), &count, &status);
  handle_->check(status, "find all its HDUs");
  return count;
}

void FitsFile::select(int index) {
  int status = 0;
  fits_movabs_hdu(cfits(handle_->file), index + 1, nullptr, &status);
  handle_->check(status, "find HDU " + std::to_string(index));
}

bool FitsFile::try_select(int index) {
  int status = 0;
  fits_movabs_hdu(cfits(handle_->file), index + 1, nullptr, &status);
  fits_clear_errmsg();
  return status == 0;
}

void FitsFile::select(const std::string& name) {
  if (!try_select(name)) handle_->fail("has no readable HDU named " + name);
}

bool FitsFile::try_select(const std::string& name) {
  int status = 0;
  std::string mutable_name = name;  // cfitsio's parameter is not const.
  fits_movnam_hdu(cfits(handle_->file), ANY_HDU, mutable_name.data(), 0, &status);
  fits_clear_errmsg();
  return status == 0;
}

bool FitsFile::is_image() {
  int status = 0;
  int kind = 0;
  fits_get_hdu_type(cfits(handle_->file), &kind, &status);
  handle_->check(status, "tell an image from a table");
  return kind == IMAGE_HDU || fits_is_compressed_image(cfits(handle_->file), &status) != 0;
}

}  // namespace curlew
