// This gives a fuzzer's bytes to code that reads a file by its path.
#pragma once

#include <sys/mman.h>
#include <unistd.h>

#include <cstddef>
#include <cstdint>
#include <string>

#include "core/error.h"

namespace curlew {

/// A file in memory; it is gone with the object.
class FuzzFile {
 public:
  FuzzFile(const std::uint8_t* bytes, std::size_t size) : file_(memfd_create("fuzz", 0)) {
    if (write(file_, bytes, size) != static_cast<ssize_t>(size)) _exit(1);
  }
  ~FuzzFile() { close(file_); }
  FuzzFile(const FuzzFile&) = delete;
  FuzzFile& operator=(const FuzzFile&) = delete;
  std::string path() const { return "/proc/self/fd/" + std::to_string(file_); }

 private:
  int file_;
};

/// Runs what may refuse its input in one sentence. Any other exception ends the fuzzer.
template <typename Act>
void refuse_or(Act&& act) {
  const auto check = [](const std::exception& error) {
    const std::string sentence = error.what();
    if (sentence.empty() || sentence.find('\n') != std::string::npos) __builtin_trap();
  };
  try {
    act();
  } catch (const Failure& failure) {
    check(failure);
  } catch (const UsageError& error) {
    check(error);
  }
}

}  // namespace curlew
