#include "acquisition/fits/partial_path.h"

#include <unistd.h>

#include <filesystem>
#include <system_error>

#include "core/error.h"

namespace curlew {

namespace fs = std::filesystem;

std::string target_of(const std::string& path) {
  std::error_code error;
  const fs::path absolute = fs::absolute(path, error);
  if (error) return path;
  const fs::path target = fs::weakly_canonical(absolute, error);
  return error ? path : target.string();
}

std::string replaceable_target(const std::string& path) {
  std::error_code none;
  const fs::file_status what = fs::status(path, none);
  if (fs::is_directory(what)) throw Failure(path + " cannot be written: it is a directory");
  if (fs::exists(what) && !fs::is_regular_file(what))
    throw Failure(path +
                  " cannot be written: it is a device, a pipe or a socket, and only a regular file "
                  "may be replaced; name a file");
  if (!fs::exists(what) && fs::is_symlink(fs::symlink_status(path, none)))
    throw Failure(path + " cannot be written: it is a link to " +
                  fs::read_symlink(path, none).string() +
                  ", which does not exist; remove the link or name another file");
  return target_of(path);
}

std::string partial_path(const std::string& target) {
  return target + "." + std::to_string(getpid()) + ".partial";
}

}  // namespace curlew
