// This lists the cameras that are attached to this machine.
#pragma once

#include <string>
#include <vector>

namespace curlew {

/// Describes one attached device, for `curlew cameras`.
struct CameraListing {
  std::string source;       ///< the word that --camera takes
  std::string description;  ///< vendor, model, serial number, address
  std::string problem;      ///< why it cannot be opened and what to do; empty if it can
};

/// Lists all that is attached, GenICam and plain USB.
std::vector<CameraListing> list_cameras();

}  // namespace curlew
