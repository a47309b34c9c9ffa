// Lists of CPUs in the kernel's notation: "0-3,8".
#pragma once

#include <string>
#include <vector>

namespace curlew {

/// Returns the CPUs, ascending and without repetition, or none if the text is empty or is no list
/// of CPUs.
std::vector<int> cpus_from(const std::string& text);

/// Returns the shortest text for these CPUs.
std::string cpu_text(std::vector<int> cpus);

}  // namespace curlew
