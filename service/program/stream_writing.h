// How text is written to pipes and devices, whose reader may be slow, or gone.
#pragma once

#include <functional>
#include <string>
#include <string_view>

namespace curlew {

/// Opens a pipe or device for writing. Where nobody reads the pipe it waits for a reader, until
/// `stop` says so. Returns the descriptor, or −1 with errno set, to ENXIO if it stopped.
int open_stream(const std::string& path, const std::function<bool()>& stop);

/// Writes to a pipe, a device or standard output, without ever blocking for long. Waits for a slow
/// reader until `stop` says so. Returns 0, or what errno says: EAGAIN if it stopped. `text` is then
/// what is left of it.
int write_stream(int fd, std::string_view& text, const std::function<bool()>& stop);

/// Returns what went wrong, in the words of a user.
std::string writing_trouble(int error);

}  // namespace curlew
