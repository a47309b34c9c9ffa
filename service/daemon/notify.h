// Supervisor tells systemd, the service manager that started the program, how the program is.
#pragma once

#include <chrono>
#include <string>

namespace curlew {

/// It speaks the protocol of sd_notify(3). Where no service manager listens ($NOTIFY_SOCKET is not
/// set) every call does nothing. Any thread may call it, but only one at a time. It never throws.
class Supervisor {
 public:
  Supervisor();

  /// Tells whether a service manager listens.
  bool listens() const { return listens_; }
  /// Returns how often the manager wants to hear from the program; 0 where it does not watch it.
  std::chrono::microseconds watchdog_period() const { return watchdog_period_; }

  /// The program is ready: it has started, or it has read its configuration again.
  void ready(const std::string& status) const;
  /// `systemctl status` shows this text, in one line.
  void status(const std::string& text) const;
  /// The program reads its configuration again. A call of ready() must follow.
  void reloading() const;
  /// The program is about to end.
  void stopping() const;
  /// The program is alive. Call this as often as you like: it sends one message in half a period.
  void watchdog();

 private:
  bool listens_ = false;
  std::chrono::microseconds watchdog_period_{0};
  std::chrono::steady_clock::time_point next_ping_;
};

}  // namespace curlew
