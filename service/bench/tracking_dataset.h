// Evolving fields on which tracking is tuned and measured, and the identities of their vortices.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "acquisition/simulator/turbulent_path.h"
#include "service/bench/detection_dataset.h"

namespace curlew {

/// The benchmark's field as it drifts. If all screens drifted alike, they would only carry the
/// pattern along. Here the wind turns and slackens along the path, so that vortices also move
/// against one another, are born and annihilate.
struct SequenceParameters {
  FieldParameters field{.rytov_variance = 2.0};  ///< what one array of lenslets sees
  /// In pitches a frame, as TurbulentPath::wind.
  std::vector<Wind> wind{{0.14, 0.03}, {0.08, -0.05}};
  /// The propagated grid is far wider than one array. So arrays × arrays of them look at it side by
  /// side.
  int arrays = 2;
  int steps = 1;  ///< times a frame at which the true vortices are looked up, to tell who is who
};

/// What one array sees, frame by frame.
struct FieldSequence {
  std::vector<Image<float>> light;  ///< [frames], each as Realisation::light
  /// [frames·steps], including vortices up to 4 pitches off the array. Frame f is step f·steps.
  std::vector<std::vector<SceneVortex>> vortices;
};

/// Returns the seed of a subset's sequences. No realisation for a detector has it, for any index
/// below 500,000.
std::uint64_t sequence_seed(Subset subset, int index);

/// Reads the first frames of the arrays² from the folder, or simulates what the folder does not
/// hold. There are files of 50 frames, with the light of all arrays and the table VORTICES (STEP,
/// X, Y, CHARGE). With an empty folder nothing is kept. step is called for every 50 frames, and may
/// throw. Throws Failure and UsageError as RealisationCache and Simulator do.
std::vector<FieldSequence> read_or_simulate(const SequenceParameters& parameters,
                                            std::uint64_t seed, int frames,
                                            const std::string& folder, int threads,
                                            const std::function<void()>& step);

/// Returns how often read_or_simulate calls step, which is the number of parts.
int sequence_parts(int frames);
/// Returns how many of these parts the folder holds.
int kept_parts(const SequenceParameters& parameters, std::uint64_t seed, int frames,
               const std::string& folder);

/// Tells who is who from step to step. Returns each vortex's identity, counted from 0 in the order
/// of appearance. A vortex continues the one of its sign in the step before whose place, moved on
/// by its last displacement, is nearest, within max_jump pitches. The nearest pairs come first, one
/// to one. Vortices without a predecessor are born, and those without a successor have died.
std::vector<std::vector<int>> identify_vortices(std::span<const std::vector<SceneVortex>> steps,
                                                double max_jump = 0.5);

}  // namespace curlew
