// A report is the page with its frames in one file, which opens without a network.
#pragma once

#include <string>

#include "service/page/frame_store.h"

namespace curlew {

/// Writes the frames that the store kept, as an HTML file under 20 MB. Where they would take more,
/// every second of them is left out, and so on; the page says so. The file appears under its name
/// when it is complete. The store must be finished. Throws Failure, which names the file.
void write_report(const std::string& path, FrameStore& store);

}  // namespace curlew
