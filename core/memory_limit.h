// This is the limit on memory that one piece of work may take. It is looked at before memory is
// taken, so that a file or a setting beyond reason gets a sentence, not the machine.
#pragma once

#include <cstdint>
#include <string>

namespace curlew {

/// Returns CURLEW_MEMORY_MB of the environment in bytes, or 1024 MB if that is not a whole number
/// from 1 on.
std::int64_t memory_limit_bytes();

/// Throws Failure if `bytes` is more than the limit: "<what> takes 6000 MB of memory, and 1024 MB
/// is the limit; CURLEW_MEMORY_MB in the environment sets another".
void require_memory(const std::string& what, double bytes);

}  // namespace curlew
