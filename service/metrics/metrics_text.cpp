#include "service/metrics/metrics_text.h"

#include <spdlog/fmt/fmt.h>

#include <cmath>

#include "service/program/version.h"

namespace curlew {
namespace {

class MetricsWriter {
 public:
  void family(const char* name, const char* type, const char* help) {
    name_ = name;
    text_ += fmt::format("# HELP curlew_{0} {2}\n# TYPE curlew_{0} {1}\n", name, type, help);
  }
  /// labels: empty, or as {outcome="lost"}.
  template <typename Number>
  void sample(const std::string& labels, Number value, const char* suffix = "") {
    text_ += fmt::format("curlew_{}{}{} {}\n", name_, suffix, labels, value);
  }
  template <typename Number>
  void single(const char* name, const char* type, const char* help, Number value) {
    family(name, type, help);
    sample("", value);
  }
  /// label: empty, or as stage="split",
  void histogram(const std::string& label, const LiveHistogram& histogram) {
    std::int64_t count = 0;
    for (std::size_t i = 0; i <= LiveHistogram::kBounds.size(); ++i) {
      count += histogram.count(i);
      const std::string bound = i < LiveHistogram::kBounds.size()
                                    ? fmt::format("{}", seconds(LiveHistogram::kBounds[i]))
                                    : "+Inf";
      sample(fmt::format("{{{}le=\"{}\"}}", label, bound), count, "_bucket");
    }
    const std::string labels =
        label.empty() ? "" : fmt::format("{{{}}}", label.substr(0, label.size() - 1));
    sample(labels, seconds(histogram.sum_ns()), "_sum");
    // The same number as the last bucket's, although frames go on meanwhile.
    sample(labels, count, "_count");
  }
  std::string text() && { return std::move(text_); }

 private:
  static double seconds(std::int64_t ns) { return static_cast<double>(ns) / 1e9; }

  std::string text_;
  std::string name_;
};

std::string outcome(const char* word) { return fmt::format("{{outcome=\"{}\"}}", word); }

void write_frames(MetricsWriter& out, const LiveMetrics& live, const StatusSnapshot& status) {
  const DaemonCounts& counts = status.counts;
  out.family("frames_total", "counter", "Frames by what became of them.");
  out.sample(outcome("result"), status.results);
  out.sample(outcome("superseded"), counts.superseded);
  out.sample(outcome("unprocessed"), counts.unprocessed);
  out.sample(outcome("lost"), counts.frames.lost);
  out.sample(outcome("incomplete"), counts.frames.incomplete);
  out.sample(outcome("timed_out"), counts.frames.timed_out);
  out.sample(outcome("aborted"), counts.frames.aborted);
  out.sample(outcome("wrong_size"), counts.frames.wrong_size);
  out.sample(outcome("other"), counts.frames.other);
  out.single("frames_no_buffer_total", "counter", "Lost frames for which no buffer was free.",
             counts.frames.no_buffer);
  out.single("results_late_total", "counter", "Results after the deadline.", live.late.load());
  out.single("results_saturated_total", "counter", "Results with a saturated pixel in a window.",
             live.saturated.load());
  out.single("splits_not_converged_total", "counter", "Splits that ended at their iteration limit.",
             live.not_converged.load());
}

void write_findings(MetricsWriter& out, const LiveMetrics& live) {
  out.single("vortices_total", "counter", "Vortices reported, over all frames.",
             live.vortices.load());
  out.single("vortices_overflow_total", "counter", "Vortices that found no room in the list.",
             live.overflow.load());
  out.single("vortices", "gauge", "Vortices in the last frame.", live.vortices_now.load());
  out.single("tracks", "gauge", "Vortices of the last frame that are followed.",
             live.tracks.seen().now);
  out.single("tracks_total", "counter", "Vortices that were ever followed.",
             live.tracks.seen().begun);
  out.family("track_life_seconds", "summary", "Time for which vortices were followed, at its end.");
  out.sample("", live.tracks.seen().life_s, "_sum");
  out.sample("", live.tracks.seen().ended, "_count");
  out.single("lenslets_valid", "gauge", "Lenslets with a slope in the last frame.",
             live.lenslets_now.load());
  out.single("lenslets_lost", "gauge", "Lenslets without a spot of their own in the last frame.",
             live.lost_now.load());
  out.single("level_adu", "gauge", "Level between the spots above the dark, mid-frame, in ADU.",
             live.level_adu.load());
  out.single("noise_adu", "gauge", "Noise of a pixel between the spots, rms, in ADU.",
             live.noise_adu.load());
}

void write_latencies(MetricsWriter& out, const LiveMetrics& live) {
  out.family("stage_latency_seconds", "histogram", "Time that a frame took in a stage.");
  for (std::size_t i = 0; i < kStageCount; ++i)
    out.histogram(fmt::format("stage=\"{}\",", kStages[i].name), live.stages[i]);
  out.histogram("stage=\"publish\",", live.publish);
  out.family("result_latency_seconds", "histogram", "Time from a frame's receipt to its results.");
  out.histogram("", live.total);
}

void write_daemon(MetricsWriter& out, const StatusSnapshot& status) {
  out.family("state", "gauge", "1 for the state that the daemon is in.");
  for (const DaemonState state :
       {DaemonState::kSearching, DaemonState::kOpening, DaemonState::kStreaming,
        DaemonState::kDegraded, DaemonState::kNoLight, DaemonState::kLost, DaemonState::kStopping})
    out.sample(fmt::format("{{state=\"{}\"}}", name_of(state)), state == status.state ? 1 : 0);
  out.single("camera_connections_total", "counter", "How often a camera was opened.",
             status.counts.connections);
  const RecorderCounts& recorder = status.counts.recorder;
  out.family("recorder_frames_total", "counter", "Frames for the recorder by what became of them.");
  out.sample(outcome("recorded"), recorder.recorded);
  out.sample(outcome("dropped"), recorder.dropped);
  out.single("recorder_files_total", "counter", "Recordings that were begun.", recorder.files);
  out.single("recorder_stopped", "gauge", "1 while the disk is full or failing.",
             recorder.stopped ? 1 : 0);
  out.family("build_info", "gauge", "1; the labels tell the program.");
  out.sample(fmt::format(R"({{program="{}",build="{}"}})", kProgram, kBuildType), 1);
}

void write_air(MetricsWriter& out, const AirReport& report) {
  const auto write = [&](const char* name, const char* help, double AirFigure::*what) {
    out.family(name, "gauge", help);
    for (const AirEntry& entry : entries_of(report))
      if (std::isfinite(entry.figure.*what))
        out.sample(fmt::format("{{figure=\"{}\"}}", entry.name), entry.figure.*what);
  };
  write("air", "The air in the last whole window, by figures that name their units.",
        &AirFigure::value);
  write("air_error", "Standard errors of those figures.", &AirFigure::error);
}

void write_beam(MetricsWriter& out, const BeamReport& beam) {
  const BeamFigures& figures = beam.figures;
  if (figures.is_lit()) {
    out.family("beam", "gauge", "The beam in the last second, by figures that name their units.");
    out.sample("{figure=\"x_lenslets\"}", figures.x);
    out.sample("{figure=\"y_lenslets\"}", figures.y);
    out.sample("{figure=\"d4sigma_x_lenslets\"}", figures.d4sigma_x);
    out.sample("{figure=\"d4sigma_y_lenslets\"}", figures.d4sigma_y);
    out.sample("{figure=\"rim_part\"}", figures.rim);
  }
  out.single("beam_cut", "gauge", "1 while the edge of the lenslets cuts the beam.",
             beam.warning.empty() ? 0 : 1);
}

}  // namespace

std::string metrics_text(const LiveMetrics& live, const StatusSnapshot& status) {
  MetricsWriter out;
  write_frames(out, live, status);
  write_findings(out, live);
  write_latencies(out, live);
  write_daemon(out, status);
  if (status.beam) write_beam(out, *status.beam);
  if (status.air) write_air(out, *status.air);
  return std::move(out).text();
}

}  // namespace curlew
