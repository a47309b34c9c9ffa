// The parts of FitsFile share this. It does not include cfitsio: only the .cpp files do.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "acquisition/fits/file_descriptor.h"
#include "acquisition/fits/fits_card.h"
#include "acquisition/fits/fits_file.h"
#include "acquisition/fits/unpacking_process.h"

namespace curlew {

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
  /// Reads compressed pixels in another process. Throws Failure if that cannot read them.
  void unpack(const UnpackingProcess::Request& request, std::span<std::byte> into);
  /// Throws the Failure for a cfitsio status other than 0, as one sentence about `doing`
  /// (a phrase with a verb: "read the key NAXIS"), and empties cfitsio's own error stack.
  void check(int status, const std::string& doing) const;
  /// Throws Failure with the text "<path> <what>".
  [[noreturn]] void fail(const std::string& what) const;
};

}  // namespace curlew
