#include "service/bench/tracking_benchmark.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <tuple>
#include <utility>

#include "core/as_size.h"
#include "core/error.h"
#include "detect/classifier/vortex_classifier.h"
#include "service/bench/bench_timing.h"
#include "service/program/parallel.h"
#include "service/results/truth_match.h"
#include "service/spot_camera.h"

namespace curlew {
namespace {

constexpr double kMinProbability = 0.02;  // the least probability of candidates
constexpr double kFrameS = 1e-3;
constexpr std::size_t kTracks = 256;  // at most, at once

/// What one array saw, frame by frame.
struct Watched {
  std::vector<std::vector<TrueVortex>> truth;
  std::vector<std::vector<Vortex>> candidates;
};

/// All arrays of the fields of one subset.
struct Fields {
  Subset subset;
  std::vector<std::vector<FieldSequence>> sequences;         // [fields, arrays²]
  std::vector<std::vector<std::vector<TrueVortex>>> truths;  // [fields·arrays², frames]
};

Fields load_fields(const TrackingBenchmarkOptions& options, Subset subset, int n,
                   const std::string& folder, const std::function<void()>& step) {
  Fields fields{subset, {}, {}};
  for (int i = 0; i < n; ++i) {
    fields.sequences.push_back(read_or_simulate(options.sequence, sequence_seed(subset, i),
                                                options.frames, folder, options.threads, step));
    for (const FieldSequence& sequence : fields.sequences.back())
      fields.truths.push_back(true_vortices(sequence.vortices, options.sequence.steps));
  }
  return fields;
}

std::vector<Watched> watch(const TrackingBenchmarkOptions& options, double photons,
                           const Fields& fields) {
  MeasurementOptions measurement = options.measurement;
  measurement.photons = photons;
  const MeasurementPlan plan(options.sequence.field, measurement);
  const ClassifierPlan classifier({.min_probability = kMinProbability}, spot_camera(plan.sensor()),
                                  plan.format());
  const int arrays = options.sequence.arrays * options.sequence.arrays;
  std::vector<Watched> watched(fields.truths.size());
  for_each_in_parallel(static_cast<int>(watched.size()), options.threads, [&](int index, int) {
    const int field = index / arrays;
    const FieldSequence& sequence = fields.sequences[as_size(field)][as_size(index % arrays)];
    Watched& one = watched[as_size(index)];
    one.truth = fields.truths[as_size(index)];
    MeasuredFrame frame(plan);
    ClassifierWorkspace workspace(classifier);
    VortexList vortices(2 * classifier.features().lenslet_count());
    // Each frame has a seed of its own for its noise.
    std::uint64_t seed =
        (sequence_seed(fields.subset, field) * 64 + static_cast<std::uint64_t>(index % arrays)) *
        1'000'000;
    for (const Image<float>& light : sequence.light) {
      measure_frame(plan, {light, {}}, seed++, frame);
      find_classified_vortices(classifier, frame.frame.view(), frame.shift(), frame.centroids,
                               frame.circulation, workspace, vortices);
      one.candidates.emplace_back(vortices.begin(), vortices.end());
    }
  });
  return watched;
}

FrameVerdicts judge(const std::vector<TrueVortex>& truth, const std::vector<Candidate>& candidates,
                    const Interior& interior) {
  std::vector<GradedVortex> graded;
  graded.reserve(truth.size());
  for (const TrueVortex& vortex : truth) graded.push_back(vortex.vortex);
  return judge_frame(candidates, graded, interior);
}

std::vector<Candidate> candidates_of(const std::vector<Vortex>& vortices) {
  std::vector<Candidate> candidates;
  for (const Vortex& vortex : vortices) {
    if (vortex.charge == 0) continue;
    candidates.push_back({static_cast<double>(vortex.x), static_cast<double>(vortex.y),
                          vortex.charge, static_cast<double>(vortex.probability)});
  }
  return candidates;
}

/// Sums over blocks of frames, which the bootstrap draws.
struct Blocks {
  std::vector<TrackingCounts> counts;
  std::vector<FrameVerdicts> verdicts;
};

void append(int block_frames, const std::vector<TrackingCounts>& counts,
            const std::vector<FrameVerdicts>& verdicts, Blocks& blocks) {
  for (std::size_t f = 0; f < counts.size(); ++f) {
    if (f % as_size(block_frames) == 0) {
      blocks.counts.emplace_back();
      blocks.verdicts.emplace_back();
    }
    blocks.counts.back() += counts[f];
    FrameVerdicts& block = blocks.verdicts.back();
    block.required += verdicts[f].required;
    block.verdicts.insert(block.verdicts.end(), verdicts[f].verdicts.begin(),
                          verdicts[f].verdicts.end());
  }
}

TrackingRow make_row(const Blocks& blocks, int samples) {
  TrackingRow row;
  for (const TrackingCounts& counts : blocks.counts) row.figures.counts += counts;
  const DetectionRecord record(blocks.verdicts);
  row.figures.average_precision = record.score(0.0).average_precision;
  const auto scores = record.bootstrap(0.0, samples, kBootstrapSeed);
  for (int sample = 0; sample < samples; ++sample) {
    TrackingFigures figures;
    draw_frames(blocks.counts.size(), kBootstrapSeed, sample,
                [&](std::size_t block) { figures.counts += blocks.counts[block]; });
    figures.average_precision = scores[as_size(sample)].average_precision;
    row.samples.push_back(figures);
  }
  return row;
}

double best_threshold(const std::vector<Watched>& validation, const Interior& interior) {
  std::vector<FrameVerdicts> verdicts;
  for (const Watched& one : validation) {
    for (std::size_t f = 0; f < one.truth.size(); ++f)
      verdicts.push_back(judge(one.truth[f], candidates_of(one.candidates[f]), interior));
  }
  return DetectionRecord(verdicts).best_threshold();
}

/// Returns the least probability of a reported track for which a tracker's F1 is best.
double best_min_probability(const TrackingBenchmarkOptions& options,
                            const std::vector<Watched>& validation, const Interior& interior) {
  double best = 0.0;
  double minimum = options.tracker.min_probability;
  for (int step = 4; step <= 18; ++step) {
    TrackerOptions tracker = options.tracker;
    tracker.min_probability = 0.05 * step;
    TrackingCounts total;
    for (const Watched& one : validation) {
      for (const TrackingCounts& frame : score_tracks(
               one.truth, track(one.candidates, tracker, options.sequence.field), interior))
        total += frame;
    }
    if (total.f1() > best) {
      best = total.f1();
      minimum = tracker.min_probability;
    }
  }
  return minimum;
}

TrackingCell run_cell(const TrackingBenchmarkOptions& options, double photons,
                      const Fields& validation, const Fields& test) {
  const FieldParameters& field = options.sequence.field;
  const Interior interior{field.rows, field.cols};
  TrackingCell cell;
  cell.photons = photons;
  const std::vector<Watched> chosen_on = watch(options, photons, validation);
  cell.threshold = best_threshold(chosen_on, interior);
  TrackerOptions chosen = options.tracker;
  chosen.min_probability = best_min_probability(options, chosen_on, interior);
  cell.min_probability = chosen.min_probability;
  TrackerOptions all = options.tracker;
  all.min_probability = all.min_probability_single = kMinProbability;
  Blocks frame_by_frame, tracked;
  std::vector<double> times_us;
  for (const Watched& one : watch(options, photons, test)) {
    std::vector<FrameVerdicts> verdicts, verdicts_tracked;
    VortexTracker tracker(all, field.rows, field.cols, kTracks);
    VortexList list(4 * kTracks);
    for (std::size_t f = 0; f < one.truth.size(); ++f) {
      verdicts.push_back(judge(one.truth[f], candidates_of(one.candidates[f]), interior));
      list.clear();
      for (const Vortex& candidate : one.candidates[f]) list.push(candidate);
      tracker.update(kFrameS * static_cast<double>(f), list);
      verdicts_tracked.push_back(
          judge(one.truth[f], candidates_of({list.begin(), list.end()}), interior));
    }
    append(options.block_frames,
           score_tracks(one.truth, link_nearest(one.candidates, cell.threshold), interior),
           verdicts, frame_by_frame);
    append(options.block_frames,
           score_tracks(one.truth, track(one.candidates, chosen, field, &times_us), interior),
           verdicts_tracked, tracked);
  }
  cell.frame_by_frame = make_row(frame_by_frame, options.bootstrap_samples);
  cell.tracked = make_row(tracked, options.bootstrap_samples);
  cell.tracker_us = median(times_us);
  return cell;
}

}  // namespace

const std::array<TrackingFigure, 10> kTrackingFigures = {{
    {"misses", "missed",
     [](const TrackingFigures& f) { return f.counts.misses() / f.counts.required; }, true},
    {"false_alarms", "false a frame",
     [](const TrackingFigures& f) { return f.counts.false_alarms / f.counts.frames; }, true},
    {"false_tracks", "false tracks a frame",
     [](const TrackingFigures& f) { return f.counts.false_tracks / f.counts.frames; }, true},
    {"switches", "switches a frame",
     [](const TrackingFigures& f) { return f.counts.switches / f.counts.frames; }, true},
    {"rms", "rms error, pitches", [](const TrackingFigures& f) { return f.counts.rms(); }, true},
    {"velocity_rms", "rms error of velocity, pitches a frame",
     [](const TrackingFigures& f) { return f.counts.velocity_rms(); }, true},
    {"f1", "F1", [](const TrackingFigures& f) { return f.counts.f1(); }, false},
    {"accuracy", "MOTA", [](const TrackingFigures& f) { return f.counts.accuracy(); }, false},
    {"identity_f1", "IDF1", [](const TrackingFigures& f) { return f.counts.identity_f1(); }, false},
    {"average_precision", "average precision",
     [](const TrackingFigures& f) { return f.average_precision; }, false},
}};

std::vector<std::vector<ReportedVortex>> link_nearest(
    const std::vector<std::vector<Vortex>>& candidates, double threshold) {
  std::vector<std::vector<ReportedVortex>> frames;
  std::vector<ReportedVortex> before;
  std::int64_t next = 0;
  for (const std::vector<Vortex>& found : candidates) {
    std::vector<ReportedVortex> now;
    for (const Candidate& candidate : candidates_of(found)) {
      if (candidate.score >= threshold)
        now.push_back({candidate.x, candidate.y, candidate.charge, -1});
    }
    std::vector<std::tuple<double, std::size_t, std::size_t>> near;
    for (std::size_t i = 0; i < before.size(); ++i) {
      for (std::size_t j = 0; j < now.size(); ++j) {
        const double away = std::hypot(before[i].x - now[j].x, before[i].y - now[j].y);
        if (before[i].charge == now[j].charge && away <= kHitRadius) near.emplace_back(away, i, j);
      }
    }
    std::sort(near.begin(), near.end());
    std::vector<bool> gone(before.size(), false);
    for (const auto& [away, i, j] : near) {
      if (gone[i] || now[j].track >= 0) continue;
      gone[i] = true;
      now[j].track = before[i].track;
      now[j].velocity_x = now[j].x - before[i].x;
      now[j].velocity_y = now[j].y - before[i].y;
    }
    for (ReportedVortex& vortex : now)
      if (vortex.track < 0) vortex.track = next++;
    frames.push_back(now);
    before = std::move(now);
  }
  return frames;
}

std::vector<std::vector<ReportedVortex>> track(const std::vector<std::vector<Vortex>>& candidates,
                                               const TrackerOptions& options,
                                               const FieldParameters& field,
                                               std::vector<double>* times_us) {
  VortexTracker tracker(options, field.rows, field.cols, kTracks);
  VortexList list(4 * kTracks);
  std::vector<std::vector<ReportedVortex>> frames;
  for (const std::vector<Vortex>& found : candidates) {
    list.clear();
    for (const Vortex& candidate : found) list.push(candidate);
    const double took_us =
        time_us([&] { tracker.update(kFrameS * static_cast<double>(frames.size()), list); });
    if (times_us != nullptr) times_us->push_back(took_us);
    std::vector<ReportedVortex>& frame = frames.emplace_back();
    for (const Vortex& vortex : list) {
      if (vortex.charge == 0) continue;
      frame.push_back({static_cast<double>(vortex.x), static_cast<double>(vortex.y), vortex.charge,
                       vortex.track, kFrameS * static_cast<double>(vortex.velocity_x),
                       kFrameS * static_cast<double>(vortex.velocity_y)});
    }
  }
  return frames;
}

std::vector<TrackingCell> run_tracking_benchmark(const TrackingBenchmarkOptions& options,
                                                 const std::string& folder,
                                                 const std::function<void()>& step) {
  if (options.frames < 1 || options.validation_fields < 1 || options.test_fields < 1 ||
      options.block_frames < 1)
    throw UsageError("tracking is measured on 1 frame and field or more");
  const Fields validation =
      load_fields(options, Subset::kValidation, options.validation_fields, folder, step);
  const Fields test = load_fields(options, Subset::kTest, options.test_fields, folder, step);
  std::vector<TrackingCell> cells;
  for (const double photons : options.photons)
    cells.push_back(run_cell(options, photons, validation, test));
  return cells;
}

}  // namespace curlew
