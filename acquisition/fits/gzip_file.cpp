#include "acquisition/fits/gzip_file.h"

#include <sys/mman.h>
#include <unistd.h>
#include <zlib.h>

#include <array>
#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <system_error>

#include "acquisition/fits/file_descriptor.h"
#include "core/error.h"
#include "core/memory_limit.h"

namespace curlew {
namespace {

constexpr std::size_t kChunk = std::size_t{256} * 1024;

struct CloseGzip {
  void operator()(gzFile file) const { gzclose(file); }
};

void write_all(int file, const std::byte* bytes, std::size_t count, const std::string& path) {
  while (count > 0) {
    const ssize_t n = write(file, bytes, count);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0)
      throw Failure(path + " cannot be unpacked: " +
                    std::error_code(errno, std::generic_category()).message());
    bytes += n;
    count -= static_cast<std::size_t>(n);
  }
}

}  // namespace

int unpack_gzip(int packed, const std::string& path) {
  const std::int64_t limit = memory_limit_bytes() / 4;
  FileDescriptor memory(memfd_create("curlew-unpacked", MFD_CLOEXEC));
  // gzdopen takes the descriptor over.
  const std::unique_ptr<gzFile_s, CloseGzip> in(gzdopen(dup(packed), "rb"));
  if (!memory || !in) throw Failure(path + " cannot be unpacked: too many files are open");
  gzbuffer(in.get(), kChunk);
  const auto chunk = std::make_unique<std::array<std::byte, kChunk>>();
  std::int64_t total = 0;
  while (const int n = gzread(in.get(), chunk->data(), kChunk)) {
    if (n < 0) break;
    total += n;
    if (total > limit)
      throw Failure(path + " unpacks to more than " + std::to_string(limit / 1'000'000) +
                    " MB: unpack it with gunzip first, or set CURLEW_MEMORY_MB in the environment "
                    "to more than four times what it needs");
    write_all(memory.get(), chunk->data(), static_cast<std::size_t>(n), path);
  }
  int error = Z_OK;
  gzerror(in.get(), &error);
  if (error != Z_OK || total == 0)
    throw Failure(path + " is truncated or damaged: gzip cannot unpack it");
  return memory.release();
}

}  // namespace curlew
