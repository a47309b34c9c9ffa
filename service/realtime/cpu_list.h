// CPU lists as the kernel writes them: "0-3,8".
#pragma once

#include <string>
#include <vector>

namespace curlew {

/// Ascending and without repetition; nothing where the text is empty or no CPU list.
std::vector<int> cpus_from(const std::string& text);

/// The shortest text for these CPUs.
std::string cpu_text(std::vector<int> cpus);

}  // namespace curlew
