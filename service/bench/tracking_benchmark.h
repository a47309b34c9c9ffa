// The benchmark of tracking: detection frame by frame against detection with a tracker behind it.
#pragma once

#include <array>
#include <functional>
#include <string_view>
#include <vector>

#include "detect/tracking/vortex_tracker.h"
#include "service/bench/detection_measurement.h"
#include "service/bench/detection_score.h"
#include "service/bench/tracking_dataset.h"
#include "service/bench/tracking_score.h"

namespace curlew {

struct TrackingBenchmarkOptions {
  SequenceParameters sequence;
  std::vector<double> photons{1000.0, 200.0};
  MeasurementOptions measurement;  ///< its photons are not used
  TrackerOptions tracker;          ///< its min_probability is not used
  int frames = 500;
  /// Only choose the threshold; as every field, each is seen by arrays² arrays.
  int validation_fields = 1;
  int test_fields = 1;
  int block_frames = 50;  ///< length of the blocks of successive frames that the bootstrap draws
  int bootstrap_samples = 1000;
  int threads = 1;
};

/// The counts at one operating point, and the average precision of the ranking.
struct TrackingFigures {
  TrackingCounts counts;
  double average_precision = 0.0;
};

struct TrackingFigure {
  std::string_view name;  ///< the key in JSON
  std::string_view heading;
  double (*value)(const TrackingFigures&);
  bool less_is_better;
};
extern const std::array<TrackingFigure, 10> kTrackingFigures;

struct TrackingRow {
  TrackingFigures figures;
  std::vector<TrackingFigures> samples;  ///< the same blocks in all rows, one by one
};

struct TrackingCell {
  double photons = 0.0;
  // Each of these two gives the best F1 on the validation fields.
  double threshold = 0.0;        ///< threshold of detection frame by frame
  double min_probability = 0.0;  ///< TrackerOptions::min_probability
  TrackingRow frame_by_frame;
  TrackingRow tracked;
  double tracker_us = 0.0;  ///< µs a frame, median
};

/// Compares the trained detector's candidates frame by frame with what a VortexTracker makes of
/// them. Frame by frame, candidates above the threshold are linked to the nearest of their charge
/// in the frame before, within kHitRadius, as one would do without a tracker. step is called for
/// every part of a sequence, and may throw.
std::vector<TrackingCell> run_tracking_benchmark(const TrackingBenchmarkOptions& options,
                                                 const std::string& folder,
                                                 const std::function<void()>& step);

/// Returns the vortices frame by frame. Each has the track of the nearest of its charge in the
/// frame before.
std::vector<std::vector<ReportedVortex>> link_nearest(
    const std::vector<std::vector<Vortex>>& candidates, double threshold);

/// Returns what the tracker reports of the candidates.
std::vector<std::vector<ReportedVortex>> track(const std::vector<std::vector<Vortex>>& candidates,
                                               const TrackerOptions& options,
                                               const FieldParameters& field,
                                               std::vector<double>* times_us = nullptr);

}  // namespace curlew
