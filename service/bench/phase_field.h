// The true complex field over the lenslets of a benchmark realisation, and its cache on disk.
#pragma once

#include <complex>
#include <cstdint>
#include <optional>
#include <string>

#include "acquisition/simulator/field.h"
#include "service/bench/detection_dataset.h"

namespace curlew {

inline constexpr int kPhaseFieldSamples = 8;  ///< points along a lenslet's side, at least

/// Points of the propagated field over the array, without margin. Point (i, j) lies at (first +
/// j/n, first + i/n) in lenslet units, where n = samples_per_lenslet.
struct PhaseField {
  Image<std::complex<float>> values;  ///< [rows·n, cols·n]
  int samples_per_lenslet = 0;
  double first = 0.0;

  double coordinate(int index) const {
    return first + static_cast<double>(index) / samples_per_lenslet;
  }
};

/// Returns the very field that simulate_realisation() turns into light, for the same parameters and
/// seed. Every so many of its points are kept, and none are averaged. Throws as Simulator does.
PhaseField simulate_phase_field(const FieldParameters& parameters, std::uint64_t seed);

/// Keeps fields in a folder, one FITS file each, [2, rows·n, cols·n], the real part first. As with
/// RealisationCache, the name does not stand for the program's version, and many may use it at
/// once.
class PhaseFieldCache {
 public:
  /// folder: made if it is missing; empty: nothing is kept. Throws Failure if it cannot be made.
  explicit PhaseFieldCache(std::string folder);

  bool holds(const FieldParameters& parameters, std::uint64_t seed) const;
  /// Reads the field, or simulates and keeps it. A file that cannot be used is replaced.
  PhaseField read_or_simulate(const FieldParameters& parameters, std::uint64_t seed) const;

 private:
  std::string path_of(const FieldParameters& parameters, std::uint64_t seed) const;
  std::optional<PhaseField> read(const FieldParameters& parameters, std::uint64_t seed) const;

  std::string folder_;
};

}  // namespace curlew
