#include "service/program/interrupt.h"

#include <atomic>
#include <csignal>

#include "core/stop_request.h"

namespace curlew {
namespace {

// These are lock-free, so that a signal handler may set them while any thread looks at them.
std::atomic<bool> reload_requested{false};
std::atomic<bool> trigger_requested{false};

}  // namespace

void catch_signals() {
  const auto note = [](int) { stop_requested = true; };
  std::signal(SIGINT, note);
  std::signal(SIGTERM, note);
  std::signal(SIGPIPE, SIG_IGN);
}

void catch_daemon_signals() {
  std::signal(SIGHUP, [](int) { reload_requested = true; });
  std::signal(SIGUSR1, [](int) { trigger_requested = true; });
}

bool interrupted() noexcept { return stop_requested; }
bool take_reload_request() noexcept { return reload_requested.exchange(false); }
bool take_trigger_request() noexcept { return trigger_requested.exchange(false); }

}  // namespace curlew
