// Signals as flags that loops look at.
#pragma once

namespace curlew {

/// From now on SIGINT and SIGTERM only set a flag, and writing to a closed pipe is an error like
/// any other.
void catch_signals();

/// From now on SIGHUP, which asks the daemon to reload, and SIGUSR1, which triggers its recorder,
/// only set a flag too.
void catch_daemon_signals();

/// Returns whether SIGINT or SIGTERM came. Then the run shall end in order, with complete files.
bool interrupted() noexcept;

/// These return whether SIGHUP (reload) or SIGUSR1 (trigger) came since the last call.
bool take_reload_request() noexcept;
bool take_trigger_request() noexcept;

}  // namespace curlew
