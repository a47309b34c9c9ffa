// The detectors that are compared, in one table.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "service/bench/detection_measurement.h"
#include "service/bench/detection_score.h"

namespace curlew {

/// A detector: from a measured frame to the candidates it sees, as many as it likes.
struct DetectorRow {
  std::string name;    ///< in the table and as the key in JSON
  std::string method;  ///< one line: what it is, and whose
  /// Several threads may call it at once, each with a frame of its own.
  std::function<std::vector<Candidate>(const MeasuredFrame&)> find;
};

/// All detectors for frames of this plan, which must outlive them. A new detector is a new entry.
/// For each of controlled_rates, false alarms a frame in slope noise alone, there are the last two
/// again, held to it: "whitened@RATE" and "classifier@RATE".
std::vector<DetectorRow> make_detector_rows(const MeasurementPlan& plan,
                                            const std::vector<double>& controlled_rates = {});

}  // namespace curlew
