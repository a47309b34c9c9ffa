// What is attached to this machine.
#pragma once

#include <string>
#include <vector>

namespace curlew {

/// One attached device, for `curlew cameras`.
struct CameraListing {
  std::string source;       ///< what --camera takes
  std::string description;  ///< vendor, model, serial number, address
  std::string problem;      ///< why it cannot be opened and what to do; empty where it can
};

/// All that is attached, GenICam and plain USB.
std::vector<CameraListing> list_cameras();

}  // namespace curlew
