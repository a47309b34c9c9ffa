// This writes results as AOT, the exchange format of adaptive-optics telemetry.
#pragma once

#include <string>

namespace curlew {

struct AotInputs {
  std::string results;    ///< by replay --save slopes,flux
  std::string recording;  ///< the recording that was replayed
  std::string sensor;
};

/// Writes the measurements of an open loop: slopes (rad of phase a pitch), intensities, mask,
/// reference, frames, dark, flat, bad pixels and times, and the vortices as a table that readers of
/// AOT pass over. docs/files.md tells every HDU. Throws Failure if a file cannot be used or the
/// three do not belong together.
void export_aot(const AotInputs& inputs, const std::string& out);

}  // namespace curlew
