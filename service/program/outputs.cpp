#include "service/program/outputs.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string_view>
#include <system_error>

#include "acquisition/fits/partial_path.h"
#include "core/error.h"
#include "core/printable.h"
#include "service/program/interrupt.h"
#include "service/program/stream_writing.h"

namespace curlew {
namespace {

namespace fs = std::filesystem;

void refuse_inputs(const std::string& output, const std::vector<std::string>& inputs) {
  for (const std::string& input : inputs) {
    std::error_code none;
    if (!output.empty() && !input.empty() && fs::equivalent(output, input, none))
      throw UsageError(output + " is an input of this run, write to another file");
  }
}

}  // namespace

void check_output(const std::string& output, const std::vector<std::string>& inputs,
                  Existing existing) {
  if (output.empty()) return;
  refuse_inputs(output, inputs);
  std::error_code none;
  if (fs::exists(replaceable_target(output), none) && existing == Existing::kRefused)
    throw UsageError(output + " exists already: name another file, or give --force to replace it");
}

void check_stream_output(const std::string& output, const std::vector<std::string>& inputs,
                         Existing existing) {
  if (!is_standard_output(output) && !is_stream(output)) check_output(output, inputs, existing);
}

bool is_stream(const std::string& path) {
  std::error_code none;
  const fs::file_status what = fs::status(path, none);
  return fs::is_fifo(what) || fs::is_character_file(what);
}

bool is_standard_output(const std::string& output) {
  return output == "-" || output == "/dev/stdout";
}

void make_standard_output_interruptible() {
  const auto write = [](void*, const char* text, std::size_t size) -> ssize_t {
    std::string_view left(text, size);
    errno = write_stream(STDOUT_FILENO, left, interrupted);
    return errno == 0 ? static_cast<ssize_t>(size) : 0;
  };
  FILE* file = fopencookie(nullptr, "w", {nullptr, write, nullptr, nullptr});
  if (file == nullptr) return;
  std::setvbuf(file, nullptr, isatty(STDOUT_FILENO) == 1 ? _IOLBF : _IOFBF, BUFSIZ);
  stdout = file;
}

void complain(const std::string& sentence) {
  const std::string line = "curlew: " + printable(sentence) + "\n";
  std::string_view left = line;
  write_stream(STDERR_FILENO, left, interrupted);
}

int take_standard_output() {
  std::fflush(stdout);
  const int fd = fcntl(STDOUT_FILENO, F_DUPFD_CLOEXEC, STDERR_FILENO + 1);
  if (fd < 0 || dup2(STDERR_FILENO, STDOUT_FILENO) < 0)
    throw Failure("standard output cannot be used: " + std::generic_category().message(errno));
  return fd;
}

void fill_standard_descriptors() {
  for (int fd = STDIN_FILENO; fd <= STDERR_FILENO; ++fd)
    if (fcntl(fd, F_GETFD) < 0 && errno == EBADF && open("/dev/null", O_RDWR) != fd)
      _exit(EXIT_FAILURE);
}

}  // namespace curlew
