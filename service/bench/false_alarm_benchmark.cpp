#include "service/bench/false_alarm_benchmark.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "acquisition/simulator/simulator.h"
#include "centroiding/centroid.h"
#include "centroiding/slopes.h"
#include "detect/circulation.h"
#include "detect/circulation_finder.h"
#include "detect/classifier/vortex_classifier.h"
#include "detect/whitened/whitened_finder.h"
#include "service/bench/bench_frames.h"
#include "service/spot_camera.h"

namespace curlew {
namespace {

constexpr double kTwoSided95 = 1.959964;
constexpr double kHowever = 1e-6;  // the least probability where any will do

/// Returns the sensor of a simulator without a pupil: references where a plane wave's spots lie,
/// gain 1.
Sensor plane_wave_sensor(const Simulator& simulator, const SimulatorOptions& options) {
  Sensor sensor = tiled_sensor({options.rows, options.cols, options.window_px});
  sensor.optics = simulator.optics();
  sensor.detector = simulator.detector();
  sensor.background_adu = options.bias_adu;
  return sensor;
}

/// The detectors of one stated rate, and what they have reported.
struct Detectors {
  Detectors(double stated, const Image<std::uint8_t>& lenslets)
      : rate(stated),
        circulation({.false_alarms_per_frame = stated}, lenslets, lenslets.size()),
        whitened(whitened_options(stated, kHowever), lenslets, lenslets.size()),
        probable(whitened_options(stated, 0.5), lenslets, lenslets.size()) {}

  static WhitenedOptions whitened_options(double stated, double minimum) {
    WhitenedOptions options;
    options.false_alarms_per_frame = stated;
    options.min_probability = minimum;
    options.pair_sigmas = 0.0;  // two alarms side by side count as two
    return options;
  }

  double rate;
  CirculationPlan circulation;
  WhitenedPlan whitened;
  WhitenedPlan probable;
  std::int64_t of_circulation = 0;
  std::int64_t of_whitened = 0;
  std::int64_t of_whitened_probable = 0;
};

std::int64_t count(const VortexList& vortices) {
  return static_cast<std::int64_t>(vortices.size()) + vortices.overflow();
}

void count_flux(const FalseAlarmOptions& options, double photons, const std::function<void()>& step,
                std::vector<FalseAlarmCount>& counts) {
  SimulatorOptions simulated;
  simulated.rows = options.rows;
  simulated.cols = options.cols;
  simulated.window_px = options.window_px;
  simulated.photons = photons;
  simulated.read_noise_e = options.read_noise_e;
  simulated.frames = options.frames;
  simulated.seed = options.seed;
  Simulator simulator(simulated);
  const Sensor sensor = plane_wave_sensor(simulator, simulated);
  const CentroidPlan centroid(sensor, simulator.format());
  const SlopePlan slope(sensor);
  const ClassifierPlan classifier({}, spot_camera(sensor), simulator.format());
  std::int64_t of_classifier = 0;

  std::vector<Detectors> detectors;
  detectors.reserve(options.rates.size());
  for (const double rate : options.rates) detectors.emplace_back(rate, sensor.valid);

  FrameBuffer frame(simulator.format());
  Centroids centroids(options.rows, options.cols);
  SlopeField slopes(options.rows, options.cols);
  CirculationMap map(options.rows, options.cols);
  VortexList vortices(2 * sensor.valid.size());
  ClassifierWorkspace classifier_workspace(classifier);
  WhitenedWorkspace whitened_workspace(detectors.front().whitened);
  double lenslets = 0.0;
  while (simulator.next(frame) == Delivery::kFrame) {
    find_centroids(centroid, frame.view(), centroids);
    measure_weak_slopes(slope, centroids, slopes);
    circulate(slopes, map);
    lenslets += centroids.n_valid;
    find_classified_vortices(classifier, frame.view(), {}, centroids, map, classifier_workspace,
                             vortices);
    of_classifier += count(vortices);
    for (Detectors& d : detectors) {
      find_circulation_vortices(d.circulation, map, vortices);
      d.of_circulation += count(vortices);
      find_whitened_vortices(d.whitened, slopes, centroids.flux_adu, map, whitened_workspace,
                             vortices);
      d.of_whitened += count(vortices);
      find_whitened_vortices(d.probable, slopes, centroids.flux_adu, map, whitened_workspace,
                             vortices);
      d.of_whitened_probable += count(vortices);
    }
    step();
  }
  for (const Detectors& d : detectors) {
    const auto add = [&](const char* name, std::int64_t alarms) {
      counts.push_back({photons, d.rate, name, alarms, options.frames,
                        lenslets / static_cast<double>(options.frames)});
    };
    add("circulation", d.of_circulation);
    add("whitened", d.of_whitened);
    add("whitened_probable", d.of_whitened_probable);
    add("classifier", of_classifier);
  }
}

/// Returns the mean of the Poisson distribution for which a count of n lies `sigmas` standard
/// deviations below the mean, by Wilson and Hilferty's cube root.
double poisson_bound(double n, double sigmas) {
  if (!(n > 0.0)) return 0.0;
  const double root = 1.0 - 1.0 / (9.0 * n) + sigmas / (3.0 * std::sqrt(n));
  return n * root * root * root;
}

}  // namespace

double FalseAlarmCount::ratio() const {
  return static_cast<double>(alarms) / (rate * static_cast<double>(frames));
}

double FalseAlarmCount::ratio_low() const {
  return poisson_bound(static_cast<double>(alarms), -kTwoSided95) /
         (rate * static_cast<double>(frames));
}

double FalseAlarmCount::ratio_high() const {
  return poisson_bound(static_cast<double>(alarms) + 1.0, kTwoSided95) /
         (rate * static_cast<double>(frames));
}

std::vector<FalseAlarmCount> count_false_alarms(const FalseAlarmOptions& options,
                                                const std::function<void()>& step) {
  std::vector<FalseAlarmCount> counts;
  if (options.rates.empty()) return counts;
  for (const double photons : options.photons) count_flux(options, photons, step, counts);
  return counts;
}

}  // namespace curlew
