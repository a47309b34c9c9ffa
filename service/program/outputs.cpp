#include "service/program/outputs.h"

#include <filesystem>

#include "core/error.h"

namespace curlew {

void refuse_overwriting(const std::string& output, const std::vector<std::string>& inputs) {
  for (const std::string& input : inputs) {
    std::error_code none;
    if (!output.empty() && !input.empty() && std::filesystem::equivalent(output, input, none))
      throw UsageError(output + " is an input of this run, write to another file");
  }
}

}  // namespace curlew
