// FrameModes fits Zernike coefficients to frame after frame, for results that carry them.
#pragma once

#include <string>
#include <vector>

#include "reconstruct/modes/mode_fit.h"
#include "service/stages.h"

namespace curlew {

class FrameModes {
 public:
  /// Throws UsageError where the sensor has too few lenslets for any mode.
  explicit FrameModes(const Plan& plan);
  FrameModes(const FrameModes&) = delete;
  FrameModes& operator=(const FrameModes&) = delete;

  /// Sets the coefficients from Noll's j = 2 on, rad rms; there are none where the lenslets that
  /// are left do not tell the modes apart, or where the frame is of another sensor. Never allocates
  /// where `zernike` has room for kLastNoll coefficients.
  void fit(const FrameSlot& slot, std::vector<float>& zernike) noexcept;

 private:
  std::string sensor_hash_;
  ModePlan plan_;
  ModeFit fit_;
};

}  // namespace curlew
