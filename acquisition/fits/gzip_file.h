// This unpacks files that gzip has packed.
#pragma once

#include <string>

namespace curlew {

/// Unpacks the open file `packed` into memory and returns a descriptor of that, which the caller
/// closes. path: for messages. Throws Failure if the file is damaged or cut off, or if it unpacks
/// to more than a quarter of memory_limit_bytes().
int unpack_gzip(int packed, const std::string& path);

}  // namespace curlew
