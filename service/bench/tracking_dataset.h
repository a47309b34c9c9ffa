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

/// The benchmark's field as it drifts. Screens that drift alike would only carry the pattern along;
/// here the wind turns and slackens along the path, so that vortices also move against one another,
/// are born and annihilate.
struct SequenceParameters {
  FieldParameters field{.rytov_variance = 2.0};         ///< what one array of lenslets sees
  std::vector<Wind> wind{{0.14, 0.03}, {0.08, -0.05}};  ///< as TurbulentPath::wind, pitches a frame
  /// The propagated grid is far wider than one array, so arrays × arrays of them look at it side by
  /// side.
  int arrays = 2;
  int steps = 1;  ///< a frame, at which the true vortices are looked up to tell who is who
};

/// What one array sees, frame by frame.
struct FieldSequence {
  std::vector<Image<float>> light;  ///< [frames], each as Realisation::light
  /// [frames·steps]: those up to 4 pitches off the array too. Frame f is step f·steps.
  std::vector<std::vector<SceneVortex>> vortices;
};

/// The seed of a subset's sequences: none that a detector's realisations have, for any index below
/// 500,000.
std::uint64_t sequence_seed(Subset subset, int index);

/// Simulates the first frames of the arrays², or reads what the folder holds of them: files of 50
/// frames, the light of all arrays and the table VORTICES (STEP, X, Y, CHARGE). An empty folder:
/// nothing is kept. step is called for every 50 frames, and may throw. Throws Failure and
/// UsageError as RealisationCache and Simulator do.
std::vector<FieldSequence> read_or_simulate(const SequenceParameters& parameters,
                                            std::uint64_t seed, int frames,
                                            const std::string& folder, int threads,
                                            const std::function<void()>& step);

/// What read_or_simulate calls step for.
int sequence_parts(int frames);
/// Those of them that the folder holds.
int kept_parts(const SequenceParameters& parameters, std::uint64_t seed, int frames,
               const std::string& folder);

/// Who is who from step to step: each vortex's identity, from 0 in the order of appearance.
/// A vortex is the one of its sign in the step before whose place, moved on by its last
/// displacement, is nearest, within max_jump pitches; nearest pairs first, one to one. Those that
/// find no predecessor are born, those without a successor have died.
std::vector<std::vector<int>> identify_vortices(std::span<const std::vector<SceneVortex>> steps,
                                                double max_jump = 0.5);

}  // namespace curlew
