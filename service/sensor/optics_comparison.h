// This file declares the comparison of two descriptions of the same optics: of a recording's header
// with the command line or with the sensor file.
#pragma once

#include <string>

#include "core/optics.h"

namespace curlew {

/// Returns what the recording's header says otherwise, as in "pitch 150 um for 160, focal length 5
/// mm for 10": its own value first. Values that differ by up to 0.1 % agree, and what either does
/// not know is left out. It is empty where they agree.
std::string differing_optics(const Optics& recording, const Optics& other);

}  // namespace curlew
