// Errors of start-up and of files: one clear sentence that names the file, key or device and
// says what to do. Caught once, in main. The frame path throws nothing.
#pragma once

#include <stdexcept>

namespace curlew {

/// Something failed (exit code 1): a file, a device, data that cannot be used.
class Failure : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Bad usage or configuration (exit code 2).
class UsageError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

}  // namespace curlew
