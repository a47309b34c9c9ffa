// This tells what Aravis does not tell about a GigE Vision camera's network.
#pragma once

#include <string>

namespace curlew {

/// Says whether the device at an IPv4 address answers GigE Vision's discovery. It waits at most 0.3
/// s, whereas Aravis' own commands wait 2.5 s each.
bool gige_device_answers(const std::string& address);

}  // namespace curlew
