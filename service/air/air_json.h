// The air's figures as JSON, for status and JSON lines.
#pragma once

#include <cmath>
#include <nlohmann/json.hpp>

#include "service/air/air_meter.h"

namespace curlew {

/// Returns an object with frames, seconds, and each figure as {value, error}; null stands for what
/// is not known, and without_r0 says why r0 is not.
inline nlohmann::ordered_json air_json(const AirReport& report) {
  const auto known = [](double value) {
    return std::isfinite(value) ? nlohmann::json(value) : nlohmann::json(nullptr);
  };
  nlohmann::ordered_json json;
  json["first_frame"] = report.first_frame;
  json["last_frame"] = report.last_frame;
  json["frames"] = report.figures.frames;
  json["seconds"] = report.figures.seconds;
  for (const AirEntry& entry : entries_of(report))
    json[entry.name] = {{"value", known(entry.figure.value)}, {"error", known(entry.figure.error)}};
  if (!report.without_r0.empty()) json["without_r0"] = report.without_r0;
  return json;
}

}  // namespace curlew
