#include "service/daemon/notify.h"

#include <systemd/sd-daemon.h>

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <ctime>

namespace curlew {
namespace {

void send(const std::string& state) { sd_notify(0, state.c_str()); }

/// Joins the lines of the text. The protocol would take a second line for another variable.
std::string one_line(std::string text) {
  std::replace(text.begin(), text.end(), '\n', ' ');
  return text;
}

}  // namespace

Supervisor::Supervisor()
    // getenv() is safe among threads here, because nothing in the program sets a variable.
    : listens_(std::getenv("NOTIFY_SOCKET") != nullptr) {  // NOLINT(concurrency-mt-unsafe)
  std::uint64_t period_us = 0;
  if (listens_ && sd_watchdog_enabled(0, &period_us) > 0)
    watchdog_period_ = std::chrono::microseconds(period_us);
}

void Supervisor::ready(const std::string& status) const {
  if (listens_) send(std::string("READY=1\nSTATUS=").append(one_line(status)));
}

void Supervisor::status(const std::string& text) const {
  if (listens_) send(std::string("STATUS=").append(one_line(text)));
}

void Supervisor::reloading() const {
  if (!listens_) return;
  // systemd 253 and later want to know since when. Earlier versions do not mind being told.
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  const std::int64_t now_us = std::int64_t{now.tv_sec} * 1000000 + now.tv_nsec / 1000;
  send(std::string("RELOADING=1\nMONOTONIC_USEC=").append(std::to_string(now_us)));
}

void Supervisor::stopping() const {
  if (listens_) send("STOPPING=1");
}

void Supervisor::watchdog() {
  if (watchdog_period_.count() == 0) return;
  const auto now = std::chrono::steady_clock::now();
  if (now < next_ping_) return;
  next_ping_ = now + watchdog_period_ / 2;
  send("WATCHDOG=1");
}

}  // namespace curlew
