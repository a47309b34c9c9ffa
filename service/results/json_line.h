// A frame's result as a line of JSON.
#pragma once

#include <string>

#include "service/results/frame_result.h"

namespace curlew {

/// Appends the result as one JSON object and a newline, in the format of docs/files.md.
void append_json_line(const FrameResult& result, std::string& text);

}  // namespace curlew
