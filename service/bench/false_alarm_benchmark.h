// Counts false alarms: plane waves have no vortex, so every vortex reported there is a false alarm.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace curlew {

struct FalseAlarmOptions {
  std::vector<double> photons{3000.0, 1000.0, 500.0, 200.0, 100.0};  ///< photons of a lenslet
  std::vector<double> rates{1.0, 0.1, 0.01};  ///< stated false alarms a frame
  std::int64_t frames = 20000;                ///< at each flux
  int rows = 16;                              ///< lenslets
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
  double lenslets = 0.0;  ///< valid lenslets a frame, mean

  double ratio() const;  ///< alarms over stated alarms
  /// These bound the middle 95 % of what the ratio may be in the long run, for a Poisson count (by
  /// Wilson and Hilferty's cube root).
  double ratio_low() const;
  double ratio_high() const;
};

/// Takes plane waves with photon and read noise through the pipeline's default centroids, weak
/// slopes and circulation to the detectors, at every rate. The detectors are "circulation"
/// (find_circulation_vortices), "whitened" (find_whitened_vortices, however improbable its
/// vortices), "whitened_probable" (the same with its least probability, .5) and "classifier"
/// (find_classified_vortices with its least probability, which no rate controls). step is called
/// after every frame, and may throw to end the run.
std::vector<FalseAlarmCount> count_false_alarms(const FalseAlarmOptions& options,
                                                const std::function<void()>& step);

}  // namespace curlew
