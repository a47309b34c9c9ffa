// Numbers that many tests need.
#pragma once

#include <limits>
#include <numbers>

namespace curlew {

inline constexpr double kPi = std::numbers::pi;
inline constexpr double kInfinity = std::numeric_limits<double>::infinity();

}  // namespace curlew
