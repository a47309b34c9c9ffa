#include "detect/false_alarm_control.h"

#include <algorithm>
#include <cassert>
#include <cstddef>

namespace curlew {

void mark_significant(const CirculationMap& map, float threshold_sigmas,
                      Image<std::int8_t>& marks) noexcept {
  assert(marks.rows() == map.value.rows() && marks.cols() == map.value.cols());
  const float z = std::min(threshold_sigmas, 1e18F);  // This keeps z² finite.
  const float minimum = z * z;
  for (std::size_t k = 0; k < marks.size(); ++k) {
    const float value = map.value[k];
    const bool passes = (map.valid[k] != 0) & (value * value > minimum * map.variance[k]);
    marks[k] = static_cast<std::int8_t>(passes ? (value > 0.0F ? 1 : -1) : 0);
  }
}

}  // namespace curlew
