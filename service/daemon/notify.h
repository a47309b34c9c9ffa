// Supervisor: what the service manager that started the program, systemd, is told about it.
#pragma once

#include <chrono>
#include <string>

namespace curlew {

/// Speaks sd_notify(3). Where no service manager listens ($NOTIFY_SOCKET is not set) every call
/// does nothing. Any thread, one at a time. Never throws.
class Supervisor {
 public:
  Supervisor();

  /// Whether a service manager listens.
  bool listens() const { return listens_; }
  /// How often it wants to hear from the program; 0: it does not watch.
  std::chrono::microseconds watchdog_period() const { return watchdog_period_; }

  /// The program does its work, from now on or again after reloading().
  void ready(const std::string& status) const;
  /// One line for `systemctl status`.
  void status(const std::string& text) const;
  /// The configuration is being read again; ready() must follow.
  void reloading() const;
  void stopping() const;
  /// The program is alive. Call it as often as you like: a word is sent when half the period is
  /// over.
  void watchdog();

 private:
  bool listens_ = false;
  std::chrono::microseconds watchdog_period_{0};
  std::chrono::steady_clock::time_point next_ping_;
};

}  // namespace curlew
