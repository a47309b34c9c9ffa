// Output files and the inputs they must spare.
#pragma once

#include <string>
#include <vector>

namespace curlew {

/// UsageError where `output` is one of the inputs, by whatever path. An empty output is none.
void refuse_overwriting(const std::string& output, const std::vector<std::string>& inputs);

}  // namespace curlew
