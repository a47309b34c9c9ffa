#include "acquisition/isio/stream_layout.h"

namespace curlew {
namespace {

std::size_t whole_words(std::size_t bytes) { return (bytes + 7) / 8 * 8; }

}  // namespace

std::size_t bytes_of(StreamType type) {
  switch (type) {
    case StreamType::kU8:
      return 1;
    case StreamType::kU16:
      return 2;
    case StreamType::kF32:
      return 4;
    case StreamType::kF64:
      return 8;
  }
  return 0;
}

StreamLayout layout_of(const StreamMetadata& metadata) {
  constexpr std::size_t kTraceBytes = 64;
  const std::size_t data_bytes =
      metadata.nelement * bytes_of(static_cast<StreamType>(metadata.datatype));
  const std::size_t one_pid_each = whole_words(std::size_t{4} * metadata.sem);
  StreamLayout layout;
  layout.data = sizeof(StreamMetadata);
  layout.keywords = layout.data + whole_words(data_bytes);
  layout.semaphores = layout.keywords + metadata.keywords * sizeof(StreamKeyword);
  layout.log_semaphore = layout.semaphores + metadata.sem * sizeof(sem_t);
  layout.read_pids = layout.log_semaphore + sizeof(sem_t);
  layout.write_pids = layout.read_pids + one_pid_each;
  // Behind the writers' process ids come two more lists as long, semctrl and semstatus.
  layout.bytes = layout.write_pids + 3 * one_pid_each + kTraceBytes * metadata.traces;
  return layout;
}

}  // namespace curlew
