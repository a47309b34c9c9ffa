#include "service/bench/phase_field.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <filesystem>
#include <utility>
#include <vector>

#include "acquisition/fits/fits_file.h"
#include "acquisition/simulator/propagation.h"
#include "core/error.h"

namespace curlew {
namespace {

constexpr int kCacheVersion = 1;

Propagation make_propagation(const FieldParameters& parameters, std::uint64_t seed) {
  const SimulatorOptions options = simulator_options(parameters, seed);
  return {*options.turbulence, options.rows, options.cols, min_field_samples(options),
          options.seed};
}

/// Returns how many of `delivered` points along a lenslet's side are kept: the smallest divisor of
/// them that is enough, or all if there are too few.
int kept_samples(int delivered) {
  int kept = std::min(kPhaseFieldSamples, delivered);
  while (delivered % kept != 0) ++kept;
  return kept;
}

}  // namespace

PhaseField simulate_phase_field(const FieldParameters& parameters, std::uint64_t seed) {
  Propagation propagation = make_propagation(parameters, seed);
  SampledField whole;
  propagation.propagate(0, whole);
  const int delivered = whole.samples_per_lenslet;
  PhaseField field;
  field.samples_per_lenslet = kept_samples(delivered);
  const int step = delivered / field.samples_per_lenslet;
  const int skipped = (step - 1) / 2;
  field.first = (skipped + 0.5) / delivered - 0.5;
  field.values = Image<std::complex<float>>(parameters.rows * field.samples_per_lenslet,
                                            parameters.cols * field.samples_per_lenslet);
  const int start = whole.margin_lenslets * delivered + skipped;
  for (int i = 0; i < field.values.rows(); ++i)
    for (int j = 0; j < field.values.cols(); ++j)
      field.values(i, j) = whole.values(start + i * step, start + j * step);
  return field;
}

PhaseFieldCache::PhaseFieldCache(std::string folder) : folder_(std::move(folder)) {
  make_cache_folder(folder_);
}

std::string PhaseFieldCache::path_of(const FieldParameters& p, std::uint64_t seed) const {
  return (std::filesystem::path(folder_) /
          fmt::format("field{}-{}-{}-{}x{}-{}-{}-{}.fits", kCacheVersion, p.rytov_variance,
                      p.lenslet, p.rows, p.cols, p.window_px, p.samples_per_lambda_w, seed))
      .string();
}

bool PhaseFieldCache::holds(const FieldParameters& parameters, std::uint64_t seed) const {
  std::error_code error;
  return !folder_.empty() && std::filesystem::exists(path_of(parameters, seed), error);
}

std::optional<PhaseField> PhaseFieldCache::read(const FieldParameters& parameters,
                                                std::uint64_t seed) const {
  if (!holds(parameters, seed)) return std::nullopt;
  try {
    FitsFile file = FitsFile::open(path_of(parameters, seed));
    PhaseField field;
    const auto samples = file.key_int("SAMPLES");
    const auto first = file.key_double("FIRST");
    const std::vector<std::int64_t> shape = file.image().shape;
    if (!samples || !first || shape.size() != 3 || shape[0] != 2 ||
        shape[1] != *samples * parameters.rows || shape[2] != *samples * parameters.cols)
      return std::nullopt;
    field.samples_per_lenslet = static_cast<int>(*samples);
    field.first = *first;
    field.values =
        Image<std::complex<float>>(static_cast<int>(shape[1]), static_cast<int>(shape[2]));
    const std::size_t n = field.values.size();
    std::vector<float> parts(2 * n);
    file.read_pixels<float>(0, parts);
    for (std::size_t k = 0; k < n; ++k) field.values[k] = {parts[k], parts[n + k]};
    return field;
  } catch (const Failure&) {
    return std::nullopt;
  }
}

PhaseField PhaseFieldCache::read_or_simulate(const FieldParameters& parameters,
                                             std::uint64_t seed) const {
  if (std::optional<PhaseField> kept = read(parameters, seed)) return *std::move(kept);
  PhaseField field = simulate_phase_field(parameters, seed);
  if (folder_.empty()) return field;
  const std::size_t n = field.values.size();
  std::vector<float> parts(2 * n);
  for (std::size_t k = 0; k < n; ++k) {
    parts[k] = field.values[k].real();
    parts[n + k] = field.values[k].imag();
  }
  FitsFile file = FitsFile::create(path_of(parameters, seed));
  file.create_image(ElementType::kF32, {2, field.values.rows(), field.values.cols()});
  file.write_key("SEED", static_cast<std::int64_t>(seed));
  file.write_key("SAMPLES", static_cast<std::int64_t>(field.samples_per_lenslet),
                 "points a lenslet side");
  file.write_key("FIRST", field.first, "place of the first point, lenslet units");
  file.write_pixels<float>(0, parts);
  file.commit();
  return field;
}

}  // namespace curlew
