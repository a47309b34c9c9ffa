// This file holds how FitsFile creates and commits a file and words its errors.
#include "acquisition/fits/fits_file.h"

#include <fitsio.h>

#include <array>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
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

}  // namespace curlew
