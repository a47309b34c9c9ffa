// Tiles that others compressed are unpacked in another process. cfitsio's decoders write where a
// damaged tile tells them to, or never end.
#pragma once

#include <sys/types.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "acquisition/fits/file_descriptor.h"

namespace curlew {

/// Reads compressed pixels of one file in a process of its own. That process is this same program,
/// run anew with an argument that serve_unpacking_if_asked() knows. It has the file, a socket to
/// this process, and little else: a limit on memory, one on its time for each request, no way to
/// open or to write a file. When it fails, it is ended, and so is reading that file.
class UnpackingProcess {
 public:
  /// file: a FITS file, open for reading. Throws Failure if no process can be started.
  explicit UnpackingProcess(int file);
  ~UnpackingProcess();
  UnpackingProcess(const UnpackingProcess&) = delete;
  UnpackingProcess& operator=(const UnpackingProcess&) = delete;

  /// Returns how much processor time so many elements may take; the slowest decoder makes 10
  /// million a second.
  static std::int32_t time_for_ms(std::int64_t elements) {
    return static_cast<std::int32_t>(std::min<std::int64_t>(kLeast_ms + elements / 8000, kMost_ms));
  }

  struct Request {
    std::int32_t hdu = 0;       ///< 0 is the primary
    std::int32_t datatype = 0;  ///< cfitsio's, of the elements
    std::int64_t first = 0;     ///< element, in file order
    std::int64_t bytes = 0;     ///< of all elements
    std::int64_t elements = 0;
    std::int64_t in_image = 0;            ///< elements of the whole image
    std::int32_t longest_ms = kLeast_ms;  ///< of processor time; ten times that by the clock
    bool undefined_is_nan = false;        ///< only for floating types

    bool operator==(const Request&) const = default;
  };
  enum class Outcome {
    kRead,     ///< all elements are there
    kDamaged,  ///< cfitsio refused them, or the process crashed over them
    kTooLong,  ///< they took longer than the request allows
    kTooLarge  ///< they did not fit the memory
  };

  /// Fills `into`, of request.bytes bytes. What is in it after another outcome than kRead is
  /// undefined, and the object must not be used again. Where requests follow each other through an
  /// image, the process unpacks the elements of the next one meanwhile.
  Outcome read(const Request& request, std::span<std::byte> into);

 private:
  static constexpr std::int32_t kLeast_ms = 2'000;
  static constexpr std::int32_t kMost_ms = 100'000'000;

  Outcome outcome_of_death();
  bool ask(const Request& request);
  Outcome receive_answer(const Request& request, std::span<std::byte> into);

  FileDescriptor socket_;
  Request last_;
  std::optional<Request> ahead_;  ///< was asked for before it was wanted
  pid_t process_ = -1;
};

/// Serves a UnpackingProcess and never returns, if the program was started for that. Every program
/// that opens FITS files calls it first.
void serve_unpacking_if_asked(int argc, char** argv);

}  // namespace curlew
