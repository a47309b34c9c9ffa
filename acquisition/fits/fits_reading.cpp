// This file holds how FitsFile opens a file for reading and finds its HDUs. A stranger's file
// reaches cfitsio here only, and only after its headers were checked.
#include <fcntl.h>
#include <fitsio.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdint>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>

#include "acquisition/fits/fits_file.h"
#include "acquisition/fits/fits_handle.h"
#include "acquisition/fits/gzip_file.h"
#include "acquisition/fits/header_check.h"

namespace curlew {
namespace {

constexpr std::size_t kMostHdus = 10'000;

std::string capitals(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(), [](char c) {
    return c >= 'a' && c <= 'z' ? static_cast<char>(c - 'a' + 'A') : c;
  });
  return text;
}

std::string cfitsio_text(int status) {
  std::array<char, FLEN_STATUS> text{};
  fits_get_errstatus(status, text.data());
  fits_clear_errmsg();
  return text.data();
}

// Returns where the HDU after the selected one begins.
std::int64_t next_hdu(fitsfile* file) {
  LONGLONG head = 0;
  LONGLONG data = 0;
  LONGLONG end = 0;
  int status = 0;
  fits_get_hduaddrll(file, &head, &data, &end, &status);
  return status == 0 ? end : -1;
}

}  // namespace

void FitsFile::Handle::open_source() {
  // Without O_NONBLOCK, a FIFO would wait for its writer.
  source = FileDescriptor(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  if (!source) {
    if (errno == ENOENT || errno == ENOTDIR) fail("does not exist");
    fail("cannot be read: " + std::error_code(errno, std::generic_category()).message());
  }
  struct stat what {};
  if (fstat(source.get(), &what) != 0 || S_ISDIR(what.st_mode))
    fail("is a directory, not a FITS file");
  if (!S_ISREG(what.st_mode)) fail("is not a regular file");
  if (what.st_size == 0) fail("is empty");
  std::array<char, 6> head{};
  const ssize_t n = pread(source.get(), head.data(), head.size(), 0);
  const std::string_view start(head.data(), n > 0 ? static_cast<std::size_t>(n) : 0);
  if (start.starts_with("\x1f\x9d"))
    fail("is packed by compress, which is not read: unpack it first, with uncompress");
  if (start.starts_with("\x1f\x8b"))
    source = FileDescriptor(unpack_gzip(source.get(), path));
  else if (start != "SIMPLE")
    fail("is not a FITS file");
}

// Lets cfitsio read the HDU that begins at `offset`, once its header is checked. Returns false if
// there is none, or one that is cut off.
bool FitsFile::Handle::open_hdu(std::int64_t offset) {
  const RawHeader header = read_raw_header(source.get(), offset);
  rest_is_damaged = header.end == RawHeader::End::kMissing;
  if (header.end == RawHeader::End::kNone || rest_is_damaged) return false;
  const std::string where = "the header of HDU " + std::to_string(hdu_names.size());
  if (header.end == RawHeader::End::kTooLong)
    fail("is not read: " + where + " does not end within 100000 cards");
  if (const auto fault = find_header_fault(header))
    fail("is not read: " + where + " is damaged: " + *fault);

  int status = 0;
  if (file == nullptr) {
    // This name is the file that was checked, whatever has its path by now.
    fitsfile* opened = nullptr;
    const std::string name = "/proc/self/fd/" + std::to_string(source.get());
    fits_open_diskfile(&opened, name.c_str(), READONLY, &status);
    file = opened;
  } else {
    fits_movabs_hdu(cfits(file), static_cast<int>(hdu_names.size()) + 1, nullptr, &status);
  }
  if (status != 0) fail("is not read: " + where + " is damaged (" + cfitsio_text(status) + ")");
  hdu_names.push_back(capitals(header.text("EXTNAME")));
  return true;
}

void FitsFile::Handle::open_checked() {
  open_source();
  if (!open_hdu(0)) fail("is not a valid FITS file: its header is damaged or cut off");
  while (open_hdu(next_hdu(cfits(file)))) {
    if (hdu_names.size() > kMostHdus)
      fail("is not read: it has more than " + std::to_string(kMostHdus) + " HDUs");
  }
  int status = 0;
  fits_movabs_hdu(cfits(file), 1, nullptr, &status);
  check(status, "find HDU 0");
}

FitsFile FitsFile::open(const std::string& path) {
  auto handle = std::make_unique<Handle>();
  handle->path = path;
  handle->open_checked();
  return FitsFile(std::move(handle));
}

int FitsFile::hdu_count() {
  if (handle_->reading()) {
    if (handle_->rest_is_damaged)
      handle_->fail("is truncated or damaged: cannot find all its HDUs");
    return static_cast<int>(handle_->hdu_names.size());
  }
  int status = 0;
  int count = 0;
  fits_get_num_hdus(cfits(handle_->file), &count, &status);
  handle_->check(status, "find all its HDUs");
  return count;
}

void FitsFile::select(int index) {
  if (!try_select(index))
    handle_->fail("does not have what is needed: cannot find HDU " + std::to_string(index));
}

bool FitsFile::try_select(int index) {
  if (handle_->reading() && static_cast<std::size_t>(index) >= handle_->hdu_names.size())
    return false;
  int status = 0;
  fits_movabs_hdu(cfits(handle_->file), index + 1, nullptr, &status);
  fits_clear_errmsg();
  return status == 0;
}

void FitsFile::select(const std::string& name) {
  if (!try_select(name)) handle_->fail("has no readable HDU named " + name);
}

bool FitsFile::try_select(const std::string& name) {
  if (handle_->reading()) {
    const auto& names = handle_->hdu_names;
    const auto found = std::find(names.begin(), names.end(), capitals(name));
    return found != names.end() && try_select(static_cast<int>(found - names.begin()));
  }
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
