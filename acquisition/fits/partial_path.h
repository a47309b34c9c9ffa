// This says where a file is written until it is complete.
#pragma once

#include <unistd.h>

#include <filesystem>
#include <string>

namespace curlew {

/// Returns the file that `path` really names, links followed; path itself if that cannot be told.
inline std::string target_of(const std::string& path) {
  namespace fs = std::filesystem;
  std::error_code error;
  const fs::path absolute = fs::absolute(path, error);
  if (error) return path;
  const fs::path target = fs::weakly_canonical(absolute, error);
  return error ? path : target.string();
}

/// Returns a name beside the target that no other process writes to. Renaming that file to the
/// target completes it.
inline std::string partial_path(const std::string& target) {
  return target + "." + std::to_string(getpid()) + ".partial";
}

}  // namespace curlew
