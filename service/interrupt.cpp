#include "service/interrupt.h"

#include <csignal>

namespace curlew {
namespace {

volatile std::sig_atomic_t signal_came = 0;

}  // namespace

void catch_signals() {
  const auto note = [](int) { signal_came = 1; };
  std::signal(SIGINT, note);
  std::signal(SIGTERM, note);
  std::signal(SIGPIPE, SIG_IGN);
}

bool interrupted() noexcept { return signal_came != 0; }

}  // namespace curlew
