// A StreamWriter is one image in shared memory that this program updates and others read.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "acquisition/isio/mapped_stream.h"
#include "core/frame.h"

namespace curlew {

/// Describes a stream, and says what stands in its keywords UNIT and `count_name`.
struct StreamDescription {
  std::string name;
  StreamType type = StreamType::kF32;
  std::vector<std::uint32_t> size;  ///< fastest axis first
  std::string unit;                 ///< at most 15 characters
  std::string count_name;           ///< at most 15 characters; empty: the keyword is not used
  std::string count_comment;
};

/// Says which frame an update belongs to.
struct StreamStamp {
  std::int64_t frame_index = 0;
  std::int64_t sequence = 0;
  std::int64_t received_ns = 0;  ///< UTC
  std::uint32_t status = 0;
};

class StreamWriter {
 public:
  /// Makes FOLDER/NAME.im.shm. If such a file of the same description is there, made by Curlew
  /// before, it is used on, so that its readers need not open it again; its counter goes on. One of
  /// another description is replaced. Throws Failure if the folder is missing or full, if another
  /// program's stream has the name, or if a running Curlew writes it.
  StreamWriter(const std::string& folder, const StreamDescription& description);

  /// Marks the data as changing, and returns where they are.
  std::byte* begin() noexcept;
  /// Stamps the update that begin() began, and wakes the readers. It never waits: semaphores that
  /// nobody takes stay at 10.
  void end(const StreamStamp& stamp, std::int64_t count) noexcept;

 private:
  MappedStream stream_;
};

}  // namespace curlew
