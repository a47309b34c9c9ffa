// Protects the inputs of a run from being overwritten by its outputs.
#pragma once

#include <string>
#include <vector>

namespace curlew {

/// Throws UsageError if `output` is one of the inputs, by whatever path. An empty output is none.
void refuse_overwriting(const std::string& output, const std::vector<std::string>& inputs);

}  // namespace curlew
