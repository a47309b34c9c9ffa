#include "service/program/log.h"

#include <spdlog/async.h>
#include <spdlog/sinks/base_sink.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstdlib>
#include <memory>
#include <mutex>
#include <string_view>

#include "core/error.h"
#include "core/printable.h"
#include "service/program/stream_writing.h"

namespace curlew {

/// Writes to standard error, and waits while nobody reads it until close().
class Log::Sink final : public spdlog::sinks::base_sink<std::mutex> {
 public:
  void close() { closing_ = true; }

 protected:
  void sink_it_(const spdlog::details::log_msg& message) override {
    if (stuck_) return;  // The program ends, and must not wait for each line anew.
    spdlog::memory_buf_t text;
    formatter_->format(message, text);
    // What cameras and files call themselves must not look like lines of ours. The last character
    // is the newline.
    const std::string line = printable({text.data(), text.size() - 1}) + '\n';
    std::string_view left = line;
    stuck_ = write_stream(STDERR_FILENO, left, [this] { return closing_.load(); }) == EAGAIN;
  }
  void flush_() override {}

 private:
  std::atomic<bool> closing_{false};
  bool stuck_ = false;
};

Log::Log(const std::string& level) {
  constexpr std::size_t kLines = 8192;
  // It is `off` also for a word that spdlog does not know
  const auto known = spdlog::level::from_str(level);
  if (known == spdlog::level::off)
    throw UsageError("log_level must be debug, info, warning or error, not '" + level + "'");
  spdlog::init_thread_pool(kLines, 1);
  sink_ = std::make_shared<Sink>();
  auto logger = std::make_shared<spdlog::async_logger>(
      "curlew", sink_, spdlog::thread_pool(), spdlog::async_overflow_policy::overrun_oldest);
  // The journal stamps each line with its own time.
  const bool journal = std::getenv("JOURNAL_STREAM") != nullptr;  // NOLINT(concurrency-mt-unsafe)
  logger->set_pattern(journal ? "%l: %v" : "%Y-%m-%dT%H:%M:%S.%eZ %l: %v",
                      spdlog::pattern_time_type::utc);
  logger->set_level(known);
  logger->flush_on(spdlog::level::info);
  spdlog::set_default_logger(std::move(logger));
}

Log::~Log() {
  sink_->close();
  spdlog::shutdown();
}

}  // namespace curlew
