// How a float and a double stand in JSON.
#pragma once

#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>

namespace curlew {

/// Returns the number, or null if it is not finite, because JSON has none of those.
inline nlohmann::json json_number(double value) {
  return std::isfinite(value) ? nlohmann::json(value) : nlohmann::json(nullptr);
}

/// Returns the shortest decimals that read back as the same float, or null for a number that is not
/// finite, because JSON has none.
inline nlohmann::json json_float(float value) {
  if (!std::isfinite(value)) return nullptr;
  char text[32];
  const auto end = std::to_chars(text, text + sizeof text, value);
  double shortest = 0.0;
  std::from_chars(text, end.ptr, shortest);
  return shortest;
}

}  // namespace curlew
