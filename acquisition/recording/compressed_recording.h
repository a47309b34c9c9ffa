// This compresses a complete recording without loss.
#pragma once

#include <stop_token>
#include <string>

namespace curlew {

/// Writes the recording `raw` tile-compressed (Rice) under the name `compressed`, then compares
/// both, every pixel and every header. Returns false if `stop` was asked for; then `compressed`
/// does not exist. `raw` stays as it is. Throws Failure if either cannot be read or written, or if
/// they differ. program: name and version, for the key CREATOR.
bool compress_recording(const std::string& raw, const std::string& compressed,
                        const std::string& program, const std::stop_token& stop);

}  // namespace curlew
