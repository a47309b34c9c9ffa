// What the commands merge and replay share.
#pragma once

#include <string>
#include <vector>

#include "service/program/outputs.h"

namespace curlew {

/// Merges shards into `out` and prints a line on it. Throws what merge_shards() and check_output()
/// throw, and Failure if nothing was measured in any frame.
void merge_night(const std::vector<std::string>& shards, const std::string& out, Existing existing);

}  // namespace curlew
