#include "service/program/interrupt.h"

#include <atomic>
#include <csignal>

namespace curlew {
namespace {

// These are lock-free, so that a signal handler may set them while any thread looks at them.
std::atomic<bool> end_requested{false};
std::atomic<bool> reload_requested{false};
std::atomic<bool> trigger_requested{false};
static_assert(std::atomic<bool>::is_always_lock_free);

}  // namespace

void catch_signals() {
  const auto note = [](int) { end_requested = true; };
  std::signal(SIGINT, note);
  std::signal(SIGTERM, note);
  std::signal(SIGPIPE, SIG_IGN);
}

void catch_daemon_signals() {
  std::signal(SIGHUP, [](int) { reload_requested = true; });
  std::signal(SIGUSR1, [](int) { trigger_requested = true; });
}

bool interrupted() noexcept { return end_requested; }
bool take_reload_request() noexcept { return reload_requested.exchange(false); }
bool take_trigger_request() noexcept { return trigger_requested.exchange(false); }

}  // namespace curlew
