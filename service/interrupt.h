// Interrupt: Ctrl-C and SIGTERM end a run in an orderly way, with its files complete.
#pragma once

namespace curlew {

/// From now on SIGINT and SIGTERM only set a flag, and a closed pipe is an error like others.
void catch_signals();

/// Whether SIGINT or SIGTERM came. Loops over frames look at it and end.
bool interrupted() noexcept;

}  // namespace curlew
