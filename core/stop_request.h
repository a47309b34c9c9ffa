// The user's wish that the program shall end, for long loops to look at.
#pragma once

#include <atomic>
#include <string>

#include "core/error.h"

namespace curlew {

/// Set by SIGINT and SIGTERM. It is lock-free, so that a signal handler may set it.
inline std::atomic<bool> stop_requested{false};
static_assert(std::atomic<bool>::is_always_lock_free);

/// Throws Failure if the program shall end. For loops over a whole file that give nothing before
/// they are through. file: what is being read.
inline void refuse_if_stopped(const std::string& file) {
  if (stop_requested) throw Failure("interrupted while " + file + " was read");
}

}  // namespace curlew
