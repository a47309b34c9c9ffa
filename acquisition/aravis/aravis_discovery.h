// This finds and opens GenICam cameras.
#pragma once

#include <memory>
#include <string>

#include "acquisition/aravis/aravis_handle.h"

namespace curlew {

/// Releases a camera. Aravis tells a GigE Vision camera good-bye and waits seconds for its answer.
/// If nobody is there to answer, that is left to a thread which ends by itself.
struct ReleaseCamera {
  bool lost = false;        ///< whether Aravis reported the camera lost
  int control_socket = -1;  ///< Aravis' socket for a GigE Vision camera's answers; −1 for others
  void operator()(ArvCamera* camera) const noexcept;
};
using CameraPtr = std::unique_ptr<ArvCamera, ReleaseCamera>;

/// Opens a camera by its device id or its address, or the only camera there is if id is empty, and
/// takes control. From then on answers of others than the camera are refused. Throws Failure, with
/// the remedy, if it cannot. One thread at a time may open cameras.
CameraPtr open_aravis_device(const std::string& id);

/// Returns vendor, model, serial number and address of an open camera. Throws Failure if it stopped
/// answering.
std::string describe(ArvCamera* camera);

/// Returns the IPv4 address of a GigE Vision camera; empty for others.
std::string address_of(ArvCamera* camera);

}  // namespace curlew
