// MachineFiles reads what the kernel tells about the machine in /proc and /sys, below a root that a
// test may choose.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace curlew {

class MachineFiles {
 public:
  /// root: the prefix of every path; "" for this machine.
  explicit MachineFiles(std::string root) : root_(std::move(root)) {}

  /// Returns a file's text without its last newline, or nothing if it cannot be read.
  std::optional<std::string> text(const std::string& path) const;
  /// Returns the number in a file that holds one whole number, or nothing if it holds anything
  /// else.
  std::optional<std::int64_t> number(const std::string& path) const;
  /// Returns what follows `name` on the first line that begins with it, without blanks at the ends.
  std::optional<std::string> line(const std::string& path, const std::string& name) const;
  /// Returns the names in a folder that begin like this, sorted; none if there is no folder.
  std::vector<std::string> names(const std::string& folder, const std::string& beginning) const;
  bool exists(const std::string& path) const;
  bool writable(const std::string& path) const;

  /// Returns the hard limit under its name in /proc/self/limits: nothing if it is unlimited, 0 if
  /// it is not there.
  std::optional<std::int64_t> limit(const std::string& name) const;
  /// Returns whether this process has a capability. number: as in linux/capability.h.
  bool capability(int number) const;
  /// Returns the CPUs in use.
  std::vector<int> online_cpus() const;

 private:
  std::string root_;
};

}  // namespace curlew
