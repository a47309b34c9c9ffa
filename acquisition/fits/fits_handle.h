// The parts of FitsFile share this. It does not include cfitsio: only the .cpp files do.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "acquisition/fits/fits_file.h"

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

  void* memory = nullptr;  ///< the bytes of a file in memory, allocated by calloc
  std::size_t memory_bytes = 0;

  bool writing() const { return !partial.empty(); }
  /// Throws the Failure for a cfitsio status other than 0, as one sentence about `doing`
  /// (a phrase with a verb: "read the key NAXIS"), and empties cfitsio's own error stack.
  void check(int status, const std::string& doing) const;
  /// Throws Failure with the text "<path> <what>".
  [[noreturn]] void fail(const std::string& what) const;
};

}  // namespace curlew
