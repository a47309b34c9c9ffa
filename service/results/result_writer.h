// ResultWriter writes JSON lines beside the live pipeline, without ever slowing it.
#pragma once

#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <utility>

#include "core/side_queue.h"
#include "service/air/air_meter.h"
#include "service/results/frame_modes.h"
#include "service/results/frame_result.h"
#include "service/results/growing_lines.h"

namespace curlew {

class ResultWriter {
 public:
  /// path: as in GrowingLines. capacity: the most vortices a frame can have. Throws Failure if the
  /// file cannot be written; a pipe may get its reader later.
  ResultWriter(const std::string& path, const JsonLinesOptions& options, std::size_t capacity);
  ~ResultWriter() { finish(); }
  ResultWriter(const ResultWriter&) = delete;
  ResultWriter& operator=(const ResultWriter&) = delete;

  /// Lines have the coefficients of these modes, or none. Not while add() may be called.
  void show_modes(std::unique_ptr<FrameModes> modes) { modes_ = std::move(modes); }

  /// Copies the result if its frame shall get a line; never waits, allocates or throws. The
  /// publisher's thread calls it.
  void add(const FrameSlot& slot, std::int64_t dropped) noexcept;

  /// The next line tells of the air. Any thread but the publisher's may call it.
  void tell_air(const AirReport& report);

  /// Writes what is left. Do not call add() any more. Returns how many results were not written,
  /// because the disk or a reader was too slow or failed. The destructor calls it too.
  std::int64_t finish();

 private:
  void write();
  void append(const FrameResult& result);
  void write_out();

  const int every_nth_;
  const bool vortices_only_;
  std::unique_ptr<FrameModes> modes_;  ///< null: lines have none
  GrowingLines lines_;
  SideQueue<FrameResult> queue_;

  // These belong to the writing thread, while there is one.
  std::int64_t failed_ = 0;      ///< results that could not be written
  std::string text_;             ///< whole lines that are not written yet
  std::int64_t text_lines_ = 0;  ///< how many they are
  std::int64_t missing_ = 0;     ///< results that could not be written since the trouble began

  std::mutex air_mutex_;          // It guards air_.
  std::optional<AirReport> air_;  ///< what the next line tells of
  std::thread thread_;
};

}  // namespace curlew
