#include "service/realtime/cpu_list.h"

#include <algorithm>
#include <cstddef>
#include <sstream>

namespace curlew {

std::vector<int> cpus_from(const std::string& text) {
  constexpr int kMaxCpu = 1 << 16;
  std::vector<int> cpus;
  std::istringstream ranges(text);
  for (std::string range; std::getline(ranges, range, ',');) {
    std::istringstream numbers(range);
    int first = -1;
    if (!(numbers >> first)) return {};
    int last = first;
    if (numbers.peek() == '-' && !(numbers.ignore() >> last)) return {};
    if (first < 0 || last < first || last > kMaxCpu) return {};
    for (int cpu = first; cpu <= last; ++cpu) cpus.push_back(cpu);
  }
  std::sort(cpus.begin(), cpus.end());
  cpus.erase(std::unique(cpus.begin(), cpus.end()), cpus.end());
  return cpus;
}

std::string cpu_text(std::vector<int> cpus) {
  std::sort(cpus.begin(), cpus.end());
  cpus.erase(std::unique(cpus.begin(), cpus.end()), cpus.end());
  std::string text;
  for (std::size_t first = 0; first < cpus.size();) {
    std::size_t last = first;
    while (last + 1 < cpus.size() && cpus[last + 1] == cpus[last] + 1) ++last;
    if (!text.empty()) text.append(",");
    text.append(std::to_string(cpus[first]));
    if (last > first) text.append("-").append(std::to_string(cpus[last]));
    first = last + 1;
  }
  return text;
}

}  // namespace curlew
