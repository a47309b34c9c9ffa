// Trains the vortex classifier on simulated turbulence. The same options give the same weights.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "detect/classifier/classifier_network.h"
#include "service/bench/detection_dataset.h"

namespace curlew {

struct TrainingOptions {
  int fields = 800;           ///< training realisations, of five Rytov variances and ten geometries
  int validation_fields = 8;  ///< for each of the Rytov variances 1, 2 and 4
  int validation_lenslets = 60;  ///< along a side of the validation fields
  int steps = 60000;
  int batch = 512;  ///< nodes in each step
  double learning_rate = 2e-3;
  std::uint64_t seed = 1;
  bool from_shipped = false;  ///< begin with the weights that are compiled in, not at random
  bool reviewer = false;      ///< train only the reviewer, and keep all else as it is compiled in
  int threads = 1;            ///< threads that simulate fields; training itself takes one
};

/// How good a network is on validation fields, behind one turbulence and by one sensor.
struct ValidationScore {
  double rytov_variance = 0.0;
  double photons = 0.0;
  double blur = 0.0;   ///< λ/w
  double faded = 0.0;  ///< part of the lenslets
  double average_precision = 0.0;
  double f1 = 0.0;
  double rms = 0.0;

  /// Returns "2, 1000, blur 0.3: AP, F1, rms".
  std::string text() const;
};

struct TrainingReport {
  ClassifierNetwork network;  ///< the best of those that were tried on the validation subset
  std::vector<ValidationScore> validation;
  double simulating_s = 0.0;
  double measuring_s = 0.0;
  double training_s = 0.0;
  double validating_s = 0.0;
  double scouting_s = 0.0;
};

/// Trains the judge, then the scout and the screen, beside the reviewer that is compiled in; or
/// only the reviewer. log gets a line now and then. Throws what simulation throws, and what `log`
/// throws.
TrainingReport train_vortex_classifier(const TrainingOptions& options,
                                       const RealisationCache& cache,
                                       const std::function<void(const std::string&)>& log);

/// Returns the text of the file that is compiled in: a comment, then all numbers that were trained.
std::string weights_text(const TrainingReport& report, const TrainingOptions& options,
                         const std::string& command);

}  // namespace curlew
