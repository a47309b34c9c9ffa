// A frame's result as a line of JSON.
#pragma once

#include <string>

#include "service/air/air_meter.h"
#include "service/results/frame_result.h"

namespace curlew {

/// Appends the result as one JSON object and a newline, in the format of docs/files.md. air: a
/// window that is complete, or null.
void append_json_line(const FrameResult& result, std::string& text, const AirReport* air = nullptr);

}  // namespace curlew
