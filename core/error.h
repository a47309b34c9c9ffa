// These are the errors of start-up and of files. Each is one clear sentence that names the file,
// key or device and says what to do. main catches them, once. The frame path throws nothing.
#pragma once

#include <stdexcept>

namespace curlew {

/// Says that a file or a device failed, or that data cannot be used (exit code 1).
class Failure : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Says that usage or configuration is wrong (exit code 2).
class UsageError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Throws UsageError with this sentence unless the condition holds.
inline void require(bool good, const char* sentence) {
  if (!good) throw UsageError(sentence);
}

}  // namespace curlew
