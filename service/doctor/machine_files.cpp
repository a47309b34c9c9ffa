#include "service/doctor/machine_files.h"

#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <system_error>

#include "service/realtime/cpu_list.h"

namespace curlew {
namespace {

constexpr const char* kBlanks = " \t\n";

std::string trimmed(const std::string& text) {
  const std::size_t first = text.find_first_not_of(kBlanks);
  if (first == std::string::npos) return "";
  return text.substr(first, text.find_last_not_of(kBlanks) - first + 1);
}

template <typename Number>
std::optional<Number> number_from(const std::string& text, int base) {
  Number value = 0;
  const char* const end = text.data() + text.size();
  const auto [rest, error] = std::from_chars(text.data(), end, value, base);
  if (error != std::errc() || rest != end) return std::nullopt;
  return value;
}

}  // namespace

std::optional<std::string> MachineFiles::text(const std::string& path) const {
  std::ifstream file(root_ + path);
  if (!file) return std::nullopt;
  std::ostringstream bytes;
  bytes << file.rdbuf();
  if (file.bad()) return std::nullopt;
  std::string text = bytes.str();
  if (!text.empty() && text.back() == '\n') text.pop_back();
  return text;
}

std::optional<std::int64_t> MachineFiles::number(const std::string& path) const {
  const auto found = text(path);
  return found ? number_from<std::int64_t>(trimmed(*found), 10) : std::nullopt;
}

std::optional<std::string> MachineFiles::line(const std::string& path,
                                              const std::string& name) const {
  std::ifstream file(root_ + path);
  for (std::string line; std::getline(file, line);)
    if (line.rfind(name, 0) == 0) return trimmed(line.substr(name.size()));
  return std::nullopt;
}

std::vector<std::string> MachineFiles::names(const std::string& folder,
                                             const std::string& beginning) const {
  std::vector<std::string> names;
  std::error_code none;
  for (const auto& entry : std::filesystem::directory_iterator(root_ + folder, none)) {
    std::string name = entry.path().filename().string();
    if (name.rfind(beginning, 0) == 0) names.push_back(std::move(name));
  }
  std::sort(names.begin(), names.end());
  return names;
}

bool MachineFiles::exists(const std::string& path) const {
  std::error_code none;
  return std::filesystem::exists(root_ + path, none);
}

bool MachineFiles::writable(const std::string& path) const {
  return access((root_ + path).c_str(), W_OK) == 0;
}

std::optional<std::int64_t> MachineFiles::limit(const std::string& name) const {
  std::istringstream values(line("/proc/self/limits", name).value_or("0 0"));
  std::string soft, hard;
  values >> soft >> hard;
  if (hard == "unlimited") return std::nullopt;
  return number_from<std::int64_t>(hard, 10).value_or(0);
}

bool MachineFiles::capability(int number) const {
  const auto effective =
      number_from<std::uint64_t>(line("/proc/self/status", "CapEff:").value_or(""), 16);
  return effective && ((*effective >> number) & 1U) != 0;
}

std::vector<int> MachineFiles::online_cpus() const {
  return cpus_from(text("/sys/devices/system/cpu/online").value_or(""));
}

}  // namespace curlew
