// A TruthVortex says where a vortex of a simulated frame is. Only the simulator knows it.
#pragma once

#include <cstdint>

namespace curlew {

/// Describes one vortex of one simulated frame: a row of the table TRUTH.
struct TruthVortex {
  std::int64_t frame = 0;   ///< number of the frame, from 0 within the recording
  double x = 0.0;           ///< lenslet units
  double y = 0.0;           ///< lenslet units
  int charge = 0;           ///< +1 or −1
  double separation = 0.0;  ///< distance to the nearest opposite one, pitches; infinite if none
};

}  // namespace curlew
