#include "service/results/frame_modes.h"

#include "core/error.h"
#include "service/results/wavefront_meter.h"

namespace curlew {

FrameModes::FrameModes(const Plan& plan)
    : sensor_hash_(plan.sensor_hash), plan_(modes_of(plan.split)), fit_(plan_) {
  if (plan_.modes() == 0)
    throw UsageError(
        "Zernike coefficients in JSON lines need more lenslets; take out jsonl_zernike in section "
        "[daemon]");
}

void FrameModes::fit(const FrameSlot& slot, std::vector<float>& zernike) noexcept {
  zernike.clear();
  if (slot.plan->sensor_hash != sensor_hash_ || !fit_.fit(slot.slopes)) return;
  for (const double coefficient : fit_.coefficients())
    zernike.push_back(static_cast<float>(coefficient));
}

}  // namespace curlew
