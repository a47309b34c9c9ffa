// The fields on which detectors are trained, chosen and compared, and their cache on disk.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "acquisition/simulator/field.h"
#include "acquisition/simulator/simulator_options.h"
#include "core/image.h"

namespace curlew {

/// A plane wave behind turbulence, on a periodic grid, as a square array of lenslets sees it. The
/// defaults are the benchmark's.
struct FieldParameters {
  double rytov_variance = 1.0;
  double lenslet = 0.064;             ///< side, √(λL)
  int rows = 16;                      ///< lenslets. More of them cost little more: the propagated
  int cols = 16;                      ///< grid is 4 √(λL) wide, 62 lenslets of the default size
  int window_px = 6;                  ///< ±1.5 λ/w
  double samples_per_lambda_w = 2.0;  ///< pixels of .5 λ/w
};

/// What nothing may be shared between: detectors learn from the first, their thresholds and
/// whatever else is chosen come from the second, and the third only states how good they are.
enum class Subset { kTraining, kValidation, kTest };

/// The seed of a subset's realisation, index from 0 to below 1,000,000. These are frozen: change
/// them and no two figures of detection can be compared.
std::uint64_t realisation_seed(Subset subset, int index);

/// One propagated field as the sensor gets it, before any noise.
struct Realisation {
  /// [rows·window_px, cols·window_px], each lenslet's window beside the next: electrons a pixel
  /// gets on average where a lenslet of amplitude 1 gathers one electron over its whole far field.
  Image<float> light;
  /// All known, those up to 4 pitches off the array too.
  std::vector<SceneVortex> vortices;
};

/// The simulator that makes the realisation of these parameters and this seed, as its frame 0.
SimulatorOptions simulator_options(const FieldParameters& parameters, std::uint64_t seed);

/// Same parameters, same seed: the same bytes. Takes a quarter of a second at the default size, and
/// may be called by several threads at once. Throws as Simulator does.
Realisation simulate_realisation(const FieldParameters& parameters, std::uint64_t seed);

/// What a realisation costs.
struct RealisationCost {
  double seconds = 0.0;  ///< on one core, roughly
  double megabytes = 0.0;
};
RealisationCost realisation_cost(const FieldParameters& parameters);

/// Where simulated fields are kept; nothing for an empty name. Throws Failure where it cannot be
/// made.
void make_cache_folder(const std::string& folder);

/// Realisations in a folder, one FITS file each: the image and the table VORTICES (X, Y, CHARGE).
/// A file appears whole or not at all. Its name says parameters and seed, but not the program's
/// version: delete the folder when propagation has changed. Several threads and several processes
/// may use one folder at once.
class RealisationCache {
 public:
  /// Empty: nothing is kept. Else the folder is made. Throws Failure where it cannot be.
  explicit RealisationCache(std::string folder);

  const std::string& folder() const { return folder_; }
  bool holds(const FieldParameters& parameters, std::uint64_t seed) const;
  /// Reads the realisation, or simulates and keeps it. A file that cannot be used is replaced.
  Realisation read_or_simulate(const FieldParameters& parameters, std::uint64_t seed) const;

 private:
  std::string path_of(const FieldParameters& parameters, std::uint64_t seed) const;
  std::optional<Realisation> read(const FieldParameters& parameters, std::uint64_t seed) const;

  std::string folder_;
};

/// $XDG_CACHE_HOME/curlew/detection, else ~/.cache/curlew/detection; empty where neither is known.
std::string default_realisation_folder();

}  // namespace curlew
