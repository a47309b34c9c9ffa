// The beam's figures as JSON, for status and page.
#pragma once

#include <nlohmann/json.hpp>

#include "service/results/beam_figures.h"
#include "service/results/json_float.h"

namespace curlew {

/// Returns an object with x, y, d4sigma_x, d4sigma_y in lenslets, d4sigma_x_mm and d4sigma_y_mm
/// (null where the pitch is not known) and rim; or with `without`, which says why there are none.
inline nlohmann::ordered_json beam_json(const BeamFigures& beam, double pitch_m) {
  if (!beam.is_lit()) return {{"without", "no lenslet has light"}};
  const auto mm = [&](double lenslets) { return json_number(1e3 * pitch_m * lenslets); };
  return {{"x", beam.x},
          {"y", beam.y},
          {"d4sigma_x", beam.d4sigma_x},
          {"d4sigma_y", beam.d4sigma_y},
          {"d4sigma_x_mm", mm(beam.d4sigma_x)},
          {"d4sigma_y_mm", mm(beam.d4sigma_y)},
          {"rim", beam.rim}};
}

}  // namespace curlew
