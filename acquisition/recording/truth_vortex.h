// Truth: where the vortices of simulated frames are. Only `simulate` knows it.
#pragma once

#include <cstdint>

namespace curlew {

/// One vortex of one simulated frame: a row of the table TRUTH.
struct TruthVortex {
  std::int64_t frame = 0;   ///< counts from 0 within the recording
  double x = 0.0;           ///< lenslet units
  double y = 0.0;           ///< lenslet units
  int charge = 0;           ///< +1 or −1
  double separation = 0.0;  ///< to the nearest opposite, lenslet units; infinite where none
};

}  // namespace curlew
