// The air's figures as JSON, for status and JSON lines.
#pragma once

#include <nlohmann/json.hpp>

#include "service/air/air_meter.h"
#include "service/results/json_float.h"

namespace curlew {

/// Returns an object with frames, seconds, and each figure as {value, error}; null stands for what
/// is not known, and without_r0 says why r0 is not.
inline nlohmann::ordered_json air_json(const AirReport& report) {
  nlohmann::ordered_json json;
  json["first_frame"] = report.first_frame;
  json["last_frame"] = report.last_frame;
  json["frames"] = report.figures.frames;
  json["seconds"] = report.figures.seconds;
  for (const AirEntry& entry : entries_of(report))
    json[entry.name] = {{"value", json_number(entry.figure.value)},
                        {"error", json_number(entry.figure.error)}};
  if (!report.without_r0.empty()) json["without_r0"] = report.without_r0;
  return json;
}

}  // namespace curlew
