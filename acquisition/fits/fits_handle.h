// The parts of FitsFile share this: those .cpp files that call cfitsio.
#pragma once

#include <fitsio.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <type_traits>
#include <vector>

#include "acquisition/fits/file_descriptor.h"
#include "acquisition/fits/fits_card.h"
#include "acquisition/fits/fits_file.h"
#include "acquisition/fits/plain_pixels.h"
#include "acquisition/fits/unpacking_process.h"

namespace curlew {

inline fitsfile* cfits(void* file) { return static_cast<fitsfile*>(file); }

/// Returns cfitsio's code for values of this type in memory.
template <typename T>
constexpr int fits_datatype() {
  if constexpr (std::is_same_v<T, std::uint8_t>) return TBYTE;
  if constexpr (std::is_same_v<T, std::int16_t>) return TSHORT;
  if constexpr (std::is_same_v<T, std::uint16_t>) return TUSHORT;
  if constexpr (std::is_same_v<T, std::int32_t>) return TINT;
  if constexpr (std::is_same_v<T, std::uint32_t>) return TUINT;
  if constexpr (std::is_same_v<T, std::int64_t>) return TLONGLONG;
  if constexpr (std::is_same_v<T, float>) return TFLOAT;
  if constexpr (std::is_same_v<T, double>) return TDOUBLE;
}

struct FitsFile::Handle {
  Handle() = default;
  Handle(const Handle&) = delete;
  Handle& operator=(const Handle&) = delete;
  ~Handle();

  void* file = nullptr;  ///< cfitsio's fitsfile*
  std::string path;      ///< the path as the user wrote it
  std::string target;    ///< the file it names, links followed
  std::string partial;   ///< the file being written; empty when reading or in memory

  FileDescriptor source;               ///< what is read: the file, or what gzip unpacked of it
  std::vector<std::string> hdu_names;  ///< of the HDUs that may be read, in capitals
  bool rest_is_damaged = false;        ///< one more HDU begins behind them, and is cut off
  std::unique_ptr<UnpackingProcess> unpacking;  ///< once compressed pixels were read

  /// The image that pixels were last read of.
  struct PixelPlace {
    int hdu = 0;                ///< counts from 1; 0: none
    int bits = 0;               ///< BITPIX
    bool compressed = false;    ///< tile by tile
    std::int64_t elements = 0;  ///< of the image
    std::int64_t data = 0;      ///< where they begin in the file
    double zero = 0.0;          ///< BZERO
    double scale = 1.0;         ///< BSCALE
  };
  PixelPlace pixels;
  SequentialReader reader;

  std::string card;  ///< what key_value() read

  void* memory = nullptr;  ///< the bytes of a file in memory, allocated by calloc
  std::size_t memory_bytes = 0;

  bool reading() const { return static_cast<bool>(source); }
  bool writing() const { return !partial.empty(); }
  /// Checks the header of every HDU before cfitsio sees it, and lists those that may be read.
  /// Throws Failure if one of them is damaged.
  void open_checked();
  void open_source();
  bool open_hdu(std::int64_t offset);
  /// Returns the value of a key of the selected HDU, none if there is no such key. Its text is
  /// valid until the next call.
  CardValue key_value(const std::string& name);
  /// Returns where the pixels of the selected HDU are.
  const PixelPlace& find_pixels();
  /// Reads pixels past cfitsio, if they are in the file as they are asked for. Returns false if
  /// they are not.
  template <typename T>
  bool read_plain(const PixelPlace& place, std::int64_t first, std::span<T> into);
  /// Reads compressed pixels in another process. Throws Failure if that cannot read them.
  void unpack(const UnpackingProcess::Request& request, std::span<std::byte> into);
  /// Throws the Failure for a cfitsio status other than 0, as one sentence about `doing`
  /// (a phrase with a verb: "read the key NAXIS"), and empties cfitsio's own error stack.
  void check(int status, const std::string& doing) const;
  /// Throws Failure with the text "<path> <what>".
  [[noreturn]] void fail(const std::string& what) const;
};

}  // namespace curlew
