#include "service/results/result_writer.h"

#include <spdlog/spdlog.h>

#include <chrono>
#include <exception>
#include <utility>

#include "core/stage_timer.h"
#include "service/results/json_line.h"
#include "service/results/mode_results.h"

namespace curlew {
namespace {

constexpr std::size_t kResults = 512;  // so many may wait: half a second at 1 kHz
constexpr std::int64_t kFlushUs = 200'000;
constexpr std::size_t kTextBytes = 1 << 16;

}  // namespace

ResultWriter::ResultWriter(const std::string& path, const JsonLinesOptions& options,
                           std::size_t capacity)
    : every_nth_(options.every_nth),
      vortices_only_(options.vortices_only),
      lines_(path, options),
      queue_(kResults,
             [&] {
               auto result = std::make_unique<FrameResult>(capacity);
               if (options.zernike) result->zernike.reserve(kLastNoll);
               return result;
             }),
      thread_([this] { write(); }) {}

std::int64_t ResultWriter::finish() {
  if (thread_.joinable()) {
    queue_.close();
    lines_.give_up();  // this concerns pipes only: a file is still written to its end
    thread_.join();
  }
  return queue_.dropped() + failed_;
}

void ResultWriter::add(const FrameSlot& slot, std::int64_t dropped) noexcept {
  if (slot.frame_index % every_nth_ != 0 || (vortices_only_ && slot.vortices.empty())) return;
  FrameResult* result = queue_.claim();
  if (result == nullptr) return;
  result->copy(slot, dropped);
  if (modes_) modes_->fit(slot, result->zernike);
  queue_.send(result);
}

void ResultWriter::write() {
  auto flushed = std::chrono::steady_clock::now();
  FrameResult* result = nullptr;
  while (!queue_.ended()) {
    if (queue_.take_for(result, kFlushUs)) {
      append(*result);
      queue_.give_back(result);
    }
    if (!lines_.is_stream() && text_.size() < kTextBytes &&
        nanoseconds_since(flushed) < kFlushUs * 1000)
      continue;
    write_out();
    flushed = std::chrono::steady_clock::now();
  }
  write_out();
}

void ResultWriter::tell_air(const AirReport& report) {
  const std::lock_guard lock(air_mutex_);
  air_ = report;
}

void ResultWriter::append(const FrameResult& result) {
  std::unique_lock lock(air_mutex_);
  const std::optional<AirReport> air = std::exchange(air_, std::nullopt);
  lock.unlock();
  append_json_line(result, text_, air ? &*air : nullptr);
  ++text_lines_;
}

/// Writes the lines, or counts them where that cannot be done. Logs when trouble begins and ends.
void ResultWriter::write_out() {
  if (text_.empty()) return;
  if (lines_.write(text_)) {
    if (missing_ > 0)
      spdlog::info("JSON lines are written again; {} results are missing", missing_);
    missing_ = 0;
  } else {
    if (missing_ == 0)
      spdlog::error("{}; results are missing until it can be written again", lines_.trouble());
    missing_ += text_lines_;
    failed_ += text_lines_;
  }
  text_.clear();
  text_lines_ = 0;
}

}  // namespace curlew
