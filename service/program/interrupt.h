// Interrupt: signals, as flags that loops look at.
#pragma once

namespace curlew {

/// From now on SIGINT and SIGTERM only set a flag, and a closed pipe is an error like others.
void catch_signals();

/// And so do SIGHUP, which asks the daemon to reload, and SIGUSR1, which triggers its recorder.
void catch_daemon_signals();

/// Whether SIGINT or SIGTERM came: the run shall end in an orderly way, with its files complete.
bool interrupted() noexcept;

/// Whether SIGHUP, or SIGUSR1, came since the last call.
bool take_reload_request() noexcept;
bool take_trigger_request() noexcept;

}  // namespace curlew
