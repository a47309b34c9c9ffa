// MachineFiles: what the kernel tells of the machine in /proc and /sys, below a root that a test
// may choose.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace curlew {

class MachineFiles {
 public:
  /// root: before every path; "" for this machine.
  explicit MachineFiles(std::string root) : root_(std::move(root)) {}

  /// A file's text without the last line's end; nothing where it cannot be read.
  std::optional<std::string> text(const std::string& path) const;
  /// A file that is one whole number.
  std::optional<std::int64_t> number(const std::string& path) const;
  /// What follows `name` on the line that begins with it, without blanks round it.
  std::optional<std::string> line(const std::string& path, const std::string& name) const;
  /// The names in a folder that begin so, sorted; none where there is no folder.
  std::vector<std::string> names(const std::string& folder, const std::string& beginning) const;
  bool exists(const std::string& path) const;
  bool writable(const std::string& path) const;

  /// The hard limit as /proc/self/limits names it; nothing: unlimited. 0 where it is not there.
  std::optional<std::int64_t> limit(const std::string& name) const;
  /// Whether this process has a capability, by its number in linux/capability.h.
  bool capability(int number) const;
  /// The CPUs in use.
  std::vector<int> online_cpus() const;

 private:
  std::string root_;
};

}  // namespace curlew
