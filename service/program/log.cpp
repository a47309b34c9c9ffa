#include "service/program/log.h"

#include <spdlog/async.h>
#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>

#include <cstdlib>

#include "core/error.h"

namespace curlew {

Log::Log(const std::string& level) {
  constexpr std::size_t kLines = 8192;
  // It is `off` also for a word that spdlog does not know
  const auto known = spdlog::level::from_str(level);
  if (known == spdlog::level::off)
    throw UsageError("log_level must be debug, info, warning or error, not '" + level + "'");
  spdlog::init_thread_pool(kLines, 1);
  auto logger = std::make_shared<spdlog::async_logger>(
      "curlew", std::make_shared<spdlog::sinks::stderr_sink_mt>(), spdlog::thread_pool(),
      spdlog::async_overflow_policy::overrun_oldest);
  // The journal stamps each line with its own time.
  const bool journal = std::getenv("JOURNAL_STREAM") != nullptr;  // NOLINT(concurrency-mt-unsafe)
  logger->set_pattern(journal ? "%l: %v" : "%Y-%m-%dT%H:%M:%S.%eZ %l: %v",
                      spdlog::pattern_time_type::utc);
  logger->set_level(known);
  logger->flush_on(spdlog::level::info);
  spdlog::set_default_logger(std::move(logger));
}

Log::~Log() { spdlog::shutdown(); }

}  // namespace curlew
