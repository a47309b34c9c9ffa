// The dark that goes with simulated frames.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "acquisition/simulator/simulator_options.h"

namespace curlew {

/// Writes a recording of the simulated camera without any light, and prints what it wrote. words:
/// what was asked for, for the header. Throws UsageError if the frames are without noise.
void write_dark(const std::string& path, std::int64_t frames, SimulatorOptions simulated,
                const std::vector<std::string>& words);

}  // namespace curlew
