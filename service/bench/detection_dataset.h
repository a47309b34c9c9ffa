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
/// defaults are those of the benchmark.
struct FieldParameters {
  double rytov_variance = 1.0;
  double lenslet = 0.064;             ///< side of a lenslet, √(λL)
  int rows = 16;                      ///< lenslets. More of them cost little more: the propagated
  int cols = 16;                      ///< grid is 4 √(λL) wide, 62 lenslets of the default size
  int window_px = 6;                  ///< the default is ±1.5 λ/w
  double samples_per_lambda_w = 2.0;  ///< the default is pixels of .5 λ/w
  double rotation_deg = 0.0;          ///< of the lenslets' columns against the pixels' x axis
  bool neighbours = false;            ///< light beyond a window falls on the next one
};

/// The three subsets share nothing. Detectors learn from the first. Thresholds, and whatever else
/// is chosen, come from the second. The third only states how good the detectors are.
enum class Subset { kTraining, kValidation, kTest };

/// Returns the seed of a subset's realisation; index: from 0 to below 1,000,000. The seeds are
/// frozen: if they change, no two figures of detection can be compared.
std::uint64_t realisation_seed(Subset subset, int index);

/// One propagated field as the sensor gets it, before any noise.
struct Realisation {
  /// The light, [rows·window_px, cols·window_px], each lenslet's window beside the next. The unit
  /// is the mean number of electrons of a pixel where a lenslet of amplitude 1 gathers one electron
  /// over its whole far field.
  Image<float> light;
  /// All vortices that are known, including those up to 4 pitches off the array.
  std::vector<SceneVortex> vortices;
};

/// Returns the simulator's options that make this realisation as frame 0.
SimulatorOptions simulator_options(const FieldParameters& parameters, std::uint64_t seed);

/// The same parameters and seed give the same bytes. It takes a quarter of a second at the default
/// size, and several threads may call it at once. Throws as Simulator does.
Realisation simulate_realisation(const FieldParameters& parameters, std::uint64_t seed);

/// What a realisation costs.
struct RealisationCost {
  double seconds = 0.0;  ///< on one core, roughly
  double megabytes = 0.0;
};
RealisationCost realisation_cost(const FieldParameters& parameters);

/// Makes the folder in which simulated fields are kept; does nothing for an empty name. Throws
/// Failure if it cannot be made.
void make_cache_folder(const std::string& folder);

/// Keeps realisations in a folder, one FITS file each: the image and the table VORTICES (X, Y,
/// CHARGE). A file appears whole or not at all. Its name stands for parameters and seed, but not
/// for the program's version: delete the folder if propagation has changed. Several threads and
/// processes may use one folder at once.
class RealisationCache {
 public:
  /// folder: made if it is missing; empty: nothing is kept. Throws Failure if it cannot be made.
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

/// Returns $XDG_CACHE_HOME/curlew/detection, else ~/.cache/curlew/detection, or an empty name if
/// neither is known.
std::string default_realisation_folder();

}  // namespace curlew
