#include "acquisition/isio/mapped_stream.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <system_error>
#include <utility>

#include "core/error.h"

namespace curlew {
namespace {

/// A build with DAO_COMPAT has this much more metadata under the same version.
constexpr std::size_t kDaoCompatBytes = 4496 - sizeof(StreamMetadata);

[[noreturn]] void refuse(const std::string& path, const std::string& why) {
  throw Failure("stream " + path + " " + why);
}

/// Refuses what this program does not read, before any part of the file is looked for.
void check(const std::string& path, const StreamMetadata& metadata, std::size_t bytes) {
  const std::string version(metadata.version, strnlen(metadata.version, sizeof(metadata.version)));
  if (version.empty()) refuse(path, "is not complete yet; its writer has not finished making it");
  if (version != kStreamVersion)
    refuse(path, "has version '" + version + "' of ImageStreamIO, only 2.00 is read");
  if (metadata.location >= 0)
    refuse(path, "lies in the memory of a graphics card; let its writer keep it in the CPU's");
  const auto type = static_cast<StreamType>(metadata.datatype);
  if (bytes_of(type) == 0)
    refuse(path, "has elements of type " + std::to_string(metadata.datatype) +
                     "; types 1 (u8), 3 (u16), 9 (float) and 10 (double) are read");
  if (metadata.naxis < 1 || metadata.naxis > 3) refuse(path, "is damaged: it has no axes");
  std::uint64_t elements = 1;
  for (int axis = 0; axis < metadata.naxis; ++axis) {
    if (metadata.size[axis] == 0 || elements > bytes / metadata.size[axis])
      refuse(path, "is damaged: it is shorter than its axes say");
    elements *= metadata.size[axis];
  }
  if (elements != metadata.nelement) refuse(path, "is damaged: its axes contradict its length");
  constexpr std::uint64_t kCircularMask = 0xF000F;
  constexpr std::uint64_t kCircular = 0x20001;
  if ((metadata.imagetype & kCircularMask) == kCircular)
    refuse(path, "is a circular buffer, which is not read; name a stream of single images");
  const std::size_t expected = layout_of(metadata).bytes;
  if (bytes == expected) return;
  if (bytes == expected + kDaoCompatBytes)
    refuse(path, "was written by a build with DAO_COMPAT; build its writer without");
  refuse(path, "has " + std::to_string(bytes) + " bytes, and its header needs " +
                   std::to_string(expected));
}

}  // namespace

std::string stream_folder() {
  const char* named = std::getenv("MILK_SHM_DIR");  // NOLINT(concurrency-mt-unsafe)
  if (named != nullptr && *named != '\0') return named;
  std::error_code unknown;
  return std::filesystem::is_directory("/milk/shm", unknown) ? "/milk/shm" : "/tmp";
}

MappedStream MappedStream::open(const std::string& path) {
  const int descriptor = ::open(path.c_str(), O_RDWR | O_CLOEXEC);
  if (descriptor < 0 && errno == ENOENT)
    refuse(path, "does not exist; start its writer, or set MILK_SHM_DIR to the folder of streams");
  if (descriptor < 0)
    refuse(path, std::string("cannot be opened for reading and writing (its semaphores are "
                             "written to): ") +
                     std::generic_category().message(errno));
  MappedStream stream(path, descriptor);
  if (stream.bytes_ < sizeof(StreamMetadata)) refuse(path, "is too short to be a stream");
  check(path, stream.metadata(), stream.bytes_);
  stream.lay_out();
  return stream;
}

MappedStream::MappedStream(const std::string& path, int descriptor)
    : path_(path), descriptor_(descriptor) {
  struct stat status {};
  if (fstat(descriptor, &status) == 0 && status.st_size > 0) {
    bytes_ = static_cast<std::size_t>(status.st_size);
    void* base =
        mmap(nullptr, bytes_, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_POPULATE, descriptor, 0);
    if (base != MAP_FAILED) base_ = static_cast<std::byte*>(base);
  }
  if (base_ != nullptr) return;
  const int error = errno;
  close(descriptor);
  refuse(path, status.st_size > 0
                   ? std::string("cannot be mapped: ") + std::generic_category().message(error)
                   : "is empty; its writer has not finished making it");
}

MappedStream::~MappedStream() {
  if (base_ == nullptr) return;
  munmap(base_, bytes_);
  close(descriptor_);
}

MappedStream::MappedStream(MappedStream&& other) noexcept
    : path_(std::move(other.path_)),
      descriptor_(std::exchange(other.descriptor_, -1)),
      base_(std::exchange(other.base_, nullptr)),
      bytes_(other.bytes_),
      layout_(other.layout_) {}

bool MappedStream::is_current() const {
  struct stat mine {};
  struct stat named {};
  return fstat(descriptor_, &mine) == 0 && stat(path_.c_str(), &named) == 0 &&
         mine.st_ino == named.st_ino && mine.st_dev == named.st_dev;
}

}  // namespace curlew
