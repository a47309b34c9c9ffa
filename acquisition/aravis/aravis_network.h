// This tells what Aravis does not tell about a GigE Vision camera's network.
#pragma once

#include <cstdint>
#include <string>

namespace curlew {

inline constexpr std::uint16_t kGigeControlPort = 3956;  ///< of a camera

/// Says whether the device at an IPv4 address answers GigE Vision's discovery. It waits at most 0.3
/// s, whereas Aravis' own commands wait 2.5 s each.
bool gige_device_answers(const std::string& address);

}  // namespace curlew
