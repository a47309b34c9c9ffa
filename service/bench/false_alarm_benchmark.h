// False alarms counted: plane waves have no vortex, so whatever is reported there is one.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace curlew {

struct FalseAlarmOptions {
  std::vector<double> photons{3000.0, 1000.0, 500.0, 200.0, 100.0};  ///< a lenslet
  std::vector<double> rates{1.0, 0.1, 0.01};                         ///< stated, a frame
  std::int64_t frames = 20000;                                       ///< at each flux
  int rows = 16;                                                     ///< lenslets
  int cols = 16;
  int window_px = 6;
  double read_noise_e = 1.0;
  std::uint64_t seed = 7501;
};

/// How many false alarms one detector made at one flux and stated rate.
struct FalseAlarmCount {
  double photons = 0.0;
  double rate = 0.0;
  std::string detector;
  std::int64_t alarms = 0;
  std::int64_t frames = 0;
  double lenslets = 0.0;  ///< valid ones a frame, on average

  double ratio() const;  ///< of the alarms to those stated
  /// The middle 95 % of what the ratio may be in the long run, of a Poisson count (by Wilson and
  /// Hilferty's cube root).
  double ratio_low() const;
  double ratio_high() const;
};

/// Plane waves with photon and read noise, through centroids as the pipeline takes them by default,
/// weak slopes and circulation, to the detectors at every rate: "circulation"
/// (find_circulation_vortices), "whitened" (find_whitened_vortices, however improbable),
/// "whitened_probable" (the same with its least probability, .5) and "classifier"
/// (find_classified_vortices with its least probability, which no rate controls). step is called
/// after every frame, and may throw to end the run.
std::vector<FalseAlarmCount> count_false_alarms(const FalseAlarmOptions& options,
                                                const std::function<void()>& step);

}  // namespace curlew
