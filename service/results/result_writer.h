// ResultWriter writes JSON lines beside the live pipeline, without ever slowing it.
#pragma once

#include <atomic>
#include <cstdint>
#include <string>
#include <thread>

#include "core/side_queue.h"
#include "service/results/frame_result.h"
#include "service/results/json_lines.h"

namespace curlew {

class ResultWriter {
 public:
  /// Appends to the file, or writes to the pipe. capacity: the most vortices a frame can have.
  /// Throws Failure if the file or pipe cannot be opened.
  ResultWriter(const std::string& path, std::size_t capacity);
  ~ResultWriter() { finish(); }
  ResultWriter(const ResultWriter&) = delete;
  ResultWriter& operator=(const ResultWriter&) = delete;

  /// Copies the result; never waits, allocates or throws. The publisher's thread calls it.
  void add(const FrameSlot& slot, std::int64_t dropped) noexcept;

  /// Writes what is left. Do not call add() any more. Returns how many results were not written,
  /// because the disk was too slow or failed. The destructor calls it too.
  std::int64_t finish();

 private:
  void write();

  JsonLines lines_;
  SideQueue<FrameResult> queue_;
  std::atomic<std::int64_t> failed_{0};
  std::thread thread_;
};

}  // namespace curlew
