// This file holds what FitsFile does with files in memory and with single header cards.
#include <fitsio.h>

#include <array>
#include <cstdlib>
#include <memory>
#include <string>

#include "acquisition/fits/fits_file.h"
#include "acquisition/fits/fits_handle.h"
#include "acquisition/fits/hdu_bytes.h"

namespace curlew {
namespace {

constexpr std::size_t kGrowth = 100 * kFitsBlock;  // bytes, at least, by which a file grows

}  // namespace

FitsFile FitsFile::create_in_memory(const std::string& path) {
  auto handle = std::make_unique<Handle>();
  handle->path = path;
  // cfitsio takes the memory that is there at first for a part of the file.
  handle->memory_bytes = kFitsBlock;
  handle->memory = std::calloc(1, kFitsBlock);
  fitsfile* file = nullptr;
  int status = 0;
  fits_create_memfile(&file, &handle->memory, &handle->memory_bytes, kGrowth, std::realloc,
                      &status);
  handle->check(status, "begin a file in memory");
  handle->file = file;
  return FitsFile(std::move(handle));
}

std::span<const std::byte> FitsFile::memory() {
  fitsfile* file = cfits(handle_->file);
  int status = 0;
  LONGLONG head = 0;
  LONGLONG data = 0;
  LONGLONG end = 0;
  select(hdu_count() - 1);
  fits_flush_file(file, &status);
  fits_get_hduaddrll(file, &head, &data, &end, &status);
  handle_->check(status, "complete a file in memory");
  return {static_cast<const std::byte*>(handle_->memory), static_cast<std::size_t>(end)};
}

std::string FitsFile::card(const std::string& name, std::int64_t value,
                           const std::string& comment) {
  std::array<char, FLEN_CARD> text{};
  std::string number = std::to_string(value);  // cfitsio's parameter is not const.
  int status = 0;
  fits_make_key(name.c_str(), number.data(), comment.c_str(), text.data(), &status);
  std::string card = text.data();
  card.resize(80, ' ');
  return card;
}

}  // namespace curlew
