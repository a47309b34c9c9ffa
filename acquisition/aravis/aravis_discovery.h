// Finding and opening GenICam cameras.
#pragma once

#include <memory>
#include <string>

#include "acquisition/aravis/aravis_handle.h"

namespace curlew {

/// Aravis tells a GigE Vision camera good-bye and waits seconds for its answer. Where there is
/// nobody to answer that is left to a thread which ends by itself.
struct ReleaseCamera {
  bool lost = false;  ///< Aravis reported the camera lost
  void operator()(ArvCamera* camera) const noexcept;
};
using CameraPtr = std::unique_ptr<ArvCamera, ReleaseCamera>;

/// Opens by device id, by address, or the only camera there is (empty id), and takes control.
/// Failure, with the remedy, where it cannot.
CameraPtr open_aravis_device(const std::string& id);

/// Vendor, model, serial number and address of an open camera. Failure where it stopped answering.
std::string describe(ArvCamera* camera);

/// IPv4 address of a GigE Vision camera; empty for others.
std::string address_of(ArvCamera* camera);

}  // namespace curlew
