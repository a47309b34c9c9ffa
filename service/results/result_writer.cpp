#include "service/results/result_writer.h"

#include <spdlog/spdlog.h>

#include <chrono>
#include <exception>

#include "core/stage_timer.h"

namespace curlew {
namespace {

constexpr std::size_t kResults = 512;  // so many may wait: half a second at 1 kHz
constexpr std::int64_t kFlushUs = 200'000;

}  // namespace

ResultWriter::ResultWriter(const std::string& path, std::size_t capacity)
    : lines_(path, JsonLinesFile::kGrowing),
      queue_(kResults, [&] { return std::make_unique<FrameResult>(capacity); }),
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
  FrameResult* result = queue_.claim();
  if (result == nullptr) return;
  result->copy(slot, dropped);
  queue_.send(result);
}

void ResultWriter::write() {
  bool failing = false;
  auto flushed = std::chrono::steady_clock::now();
  const auto attempt = [&](auto&& action) {
    try {
      action();
    } catch (const std::exception& error) {
      if (!failing) spdlog::error("{}; no more results are written", error.what());
      failing = true;
    }
  };
  FrameResult* result = nullptr;
  while (!queue_.ended()) {
    if (queue_.take_for(result, kFlushUs)) {
      if (!failing) attempt([&] { lines_.add(*result); });
      if (failing) ++failed_;
      queue_.give_back(result);
    }
    if (failing || nanoseconds_since(flushed) < kFlushUs * 1000) continue;
    attempt([&] { lines_.flush(); });
    flushed = std::chrono::steady_clock::now();
  }
  if (!failing) attempt([&] { lines_.commit(); });
}

}  // namespace curlew
