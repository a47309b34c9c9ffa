// This says where a file is written until it is complete, and what it may replace.
#pragma once

#include <string>

namespace curlew {

/// Returns the file that `path` really names, links followed; path itself if that cannot be told.
std::string target_of(const std::string& path);

/// Returns target_of(path) where a complete file may be put there: nothing or a regular file is
/// there. Throws Failure for a directory, a device, a pipe or a socket, which are never replaced,
/// and for a link that leads nowhere.
std::string replaceable_target(const std::string& path);

/// Returns a name beside the target that no other process writes to. Renaming that file to the
/// target completes it.
std::string partial_path(const std::string& target);

}  // namespace curlew
