#include "acquisition/list_cameras.h"

#include <utility>

#include "acquisition/aravis/aravis_camera.h"
#include "acquisition/usb/usb_devices.h"

namespace curlew {

std::vector<CameraListing> list_cameras() {
  std::vector<CameraListing> listings = list_aravis_cameras();
  // Aravis lists only those USB3 Vision devices that this user may open, so the others are added
  // here.
  for (CameraListing& listing : list_usb_cameras())
    if (listing.source.rfind("usb:", 0) == 0 || !listing.problem.empty())
      listings.push_back(std::move(listing));
  return listings;
}

}  // namespace curlew
