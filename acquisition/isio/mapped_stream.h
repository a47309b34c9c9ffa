// A MappedStream is a file of a stream, mapped into this process.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "acquisition/isio/stream_layout.h"

namespace curlew {

/// Returns the folder of streams: $MILK_SHM_DIR, else /milk/shm where that exists, else /tmp.
std::string stream_folder();

class MappedStream {
 public:
  /// Opens the stream of another program for reading its data; its semaphores are written to.
  /// Throws Failure, which names the file, if it is missing, cannot be opened, is not version
  /// "2.00", is not of a StreamType, lies on a graphics card, or has another length than it should.
  static MappedStream open(const std::string& path);

  /// Maps the open file `descriptor`, which this object closes, as long as the file is. Throws
  /// Failure.
  MappedStream(const std::string& path, int descriptor);
  ~MappedStream();
  MappedStream(MappedStream&& other) noexcept;
  MappedStream& operator=(MappedStream&&) = delete;

  const std::string& path() const { return path_; }
  int descriptor() const { return descriptor_; }
  std::size_t bytes() const { return bytes_; }
  /// Says whether the file of this name is still the one that is mapped.
  bool is_current() const;

  StreamMetadata& metadata() const { return *reinterpret_cast<StreamMetadata*>(base_); }
  /// Finds the parts of the file. Call it once the metadata are there.
  void lay_out() { layout_ = layout_of(metadata()); }

  // These are valid after lay_out() or open().
  std::byte* data() const { return base_ + layout_.data; }
  std::span<StreamKeyword> keywords() const {
    return part<StreamKeyword>(layout_.keywords, metadata().keywords);
  }
  std::span<sem_t> semaphores() const { return part<sem_t>(layout_.semaphores, metadata().sem); }
  sem_t& log_semaphore() const { return part<sem_t>(layout_.log_semaphore, 1).front(); }
  std::span<std::int32_t> read_pids() const {
    return part<std::int32_t>(layout_.read_pids, metadata().sem);
  }
  std::span<std::int32_t> write_pids() const {
    return part<std::int32_t>(layout_.write_pids, metadata().sem);
  }

 private:
  template <typename T>
  std::span<T> part(std::size_t offset, std::size_t count) const {
    return {reinterpret_cast<T*>(base_ + offset), count};
  }

  std::string path_;
  int descriptor_ = -1;
  std::byte* base_ = nullptr;
  std::size_t bytes_ = 0;
  StreamLayout layout_;
};

}  // namespace curlew
