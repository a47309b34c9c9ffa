// The detectors that are compared, in one table.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "service/bench/detection_measurement.h"
#include "service/bench/detection_score.h"

namespace curlew {

/// A detector. It turns a measured frame into as many candidates as it likes.
struct DetectorRow {
  std::string name;    ///< stands in the table and is the key in JSON
  std::string method;  ///< one line that says what it is and who published it
  /// Finds the candidates. Several threads may call it at once, each with a frame of its own.
  std::function<std::vector<Candidate>(const MeasuredFrame&)> find;
};

/// Returns all detectors for frames of this plan, which must outlive them. A new detector is a new
/// entry. For each of controlled_rates, in false alarms a frame in slope noise alone, the last two
/// come again, held to that rate: "whitened@RATE" and "classifier@RATE".
std::vector<DetectorRow> make_detector_rows(const MeasurementPlan& plan,
                                            const std::vector<double>& controlled_rates = {});

}  // namespace curlew
