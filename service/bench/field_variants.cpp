#include "service/bench/field_variants.h"

#include <spdlog/fmt/fmt.h>

namespace curlew {

std::vector<FieldVariant> field_variants(const FieldParameters& field,
                                         const MeasurementOptions& measurement, bool noisy) {
  std::vector<FieldVariant> variants;
  const auto add = [&](const std::string& name) -> FieldVariant& {
    return variants.emplace_back(FieldVariant{name, field, measurement});
  };
  add("laboratory");
  for (const double blur : {0.2, 0.3, 0.4, 0.6})
    add(fmt::format("blur {} λ/w", blur)).measurement.blur = blur;
  const auto pixels = [&](const char* name, double samples, int window_px) {
    FieldVariant& variant = add(name);
    variant.field.samples_per_lambda_w = samples;
    variant.field.window_px = window_px;
  };
  pixels("pixels 1/4 λ/w", 4.0, 12);
  pixels("pixels 2/3 λ/w, window ±2", 1.5, 6);
  pixels("pixels 1 λ/w, window ±3", 1.0, 6);
  pixels("window ±1", 2.0, 4);
  pixels("window ±3", 2.0, 12);
  for (const double degrees : {10.0, 20.0, 45.0})
    add(fmt::format("lenslets turned by {} degrees", degrees)).field.rotation_deg = degrees;
  FieldVariant& neighbours = add("window ±2, neighbours' light");
  neighbours.field.window_px = 8;
  neighbours.field.neighbours = true;
  if (noisy) {
    add("read noise 3 e").measurement.read_noise_e = 3.0;
    add("sky 10 e, not in the dark").measurement.sky_e = 10.0;
  }
  add("5 % faded").measurement.faded = 0.05;
  for (const PupilShape pupil : {PupilShape::kRound, PupilShape::kObscured}) {
    FieldVariant& variant =
        add(pupil == PupilShape::kRound ? "round pupil, 5 % faded" : "obscured pupil, 5 % faded");
    variant.measurement.pupil = pupil;
    variant.measurement.faded = 0.05;
  }
  return variants;
}

}  // namespace curlew
