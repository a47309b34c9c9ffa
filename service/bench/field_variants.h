// The sensors of `bench detect --field`: what real benches do to the laboratory's frames.
#pragma once

#include <string>
#include <vector>

#include "service/bench/detection_dataset.h"
#include "service/bench/detection_measurement.h"

namespace curlew {

/// One sensor, and what is in its way.
struct FieldVariant {
  std::string name;
  FieldParameters field;
  MeasurementOptions measurement;
};

/// Returns the laboratory's sensor and its variants: blurred, with other pixels and windows,
/// turned, with read noise, faded lenslets, round and obscured pupils, a sky that the dark does not
/// have, and neighbours' light. What they do not change is as in `field` and `measurement`. Read
/// noise and sky are among them only if the frames are `noisy`.
std::vector<FieldVariant> field_variants(const FieldParameters& field,
                                         const MeasurementOptions& measurement, bool noisy);

}  // namespace curlew
