#include "service/daemon/status_printer.h"

#include <spdlog/spdlog.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <utility>

#include "service/air/air_json.h"
#include "service/program/version.h"
#include "service/results/beam_json.h"

namespace curlew {
namespace {

constexpr int kSecondsALogLine = 10;

double microseconds(std::int64_t ns) { return static_cast<double>(ns) * 1e-3; }

/// Returns the text without blanks, which part fields.
std::string one_word(std::string text) {
  std::replace(text.begin(), text.end(), ' ', '_');
  return text;
}

/// Returns how many frames each cause has kept from becoming a result or from being recorded.
std::array<std::pair<const char*, std::int64_t>, 9> causes(const StatusSnapshot& status) {
  const FrameCounts& frames = status.counts.frames;
  return {{{"lost", frames.lost},
           {"incomplete", frames.incomplete},
           {"timed_out", frames.timed_out},
           {"aborted", frames.aborted},
           {"wrong_size", frames.wrong_size},
           {"other", frames.other},
           {"superseded", status.counts.superseded},
           {"unrecorded", status.counts.recorder.dropped},
           {"refused_packets", frames.refused_packets}}};
}

/// Returns how long ago a frame was received; null where that is not known.
nlohmann::json age_s(std::int64_t received_ns) {
  if (received_ns == 0) return nullptr;
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  return 1e-9 *
         static_cast<double>(std::chrono::duration_cast<std::chrono::nanoseconds>(now).count() -
                             received_ns);
}

}  // namespace

std::string status_line(const StatusSnapshot& status) {
  const StatusWindow& window = status.window;
  std::string line =
      fmt::format("{:<9} {:>8.1f} frames/s", name_of(status.state), window.frames_per_s());
  if (window.frames > 0)
    line += fmt::format("  p50 {:.0f} p99 {:.0f} max {:.0f} µs  vortices {}",
                        microseconds(window.p50_ns), microseconds(window.p99_ns),
                        microseconds(window.max_ns), window.vortices_now);
  if (window.lost_now > 0) line += fmt::format("  lenslets lost {}", window.lost_now);
  if (window.late > 0) line += fmt::format("  late {}", window.late);
  if (status.beam && !status.beam->warning.empty()) line += "  " + status.beam->warning;
  for (const auto& [name, count] : causes(status))
    if (count > 0) line += fmt::format("  {} {}", name, count);
  if (status.recording)
    line += status.counts.recorder.stopped
                ? "  recording stopped"
                : fmt::format("  recorded {}", status.counts.recorder.recorded);
  return line;
}

std::string beam_line(const BeamReport& beam) {
  const BeamFigures& figures = beam.figures;
  if (!figures.is_lit())
    return "no beam: " + (beam.warning.empty() ? "no lenslet has light" : beam.warning);
  std::string line = fmt::format("beam at x {:.2f}, y {:.2f}, D4σ {:.2f} x {:.2f} lenslets",
                                 figures.x, figures.y, figures.d4sigma_x, figures.d4sigma_y);
  if (std::isfinite(beam.pitch_m))
    line += fmt::format(" ({:.3g} x {:.3g} mm)", 1e3 * beam.pitch_m * figures.d4sigma_x,
                        1e3 * beam.pitch_m * figures.d4sigma_y);
  line += fmt::format(", {:.0f} % at the rim", 100.0 * figures.rim);
  return beam.warning.empty() ? line : line + "; " + beam.warning;
}

std::string status_fields(const StatusSnapshot& status) {
  const StatusWindow& window = status.window;
  std::string line = fmt::format(
      "state={} results={} frames_per_s={:.1f} p50_us={:.1f} p99_us={:.1f} max_us={:.1f} "
      "valid={} lenslets_lost={} vortices={} late={}",
      one_word(name_of(status.state)), status.results, window.frames_per_s(),
      microseconds(window.p50_ns), microseconds(window.p99_ns), microseconds(window.max_ns),
      window.valid_now, window.lost_now, window.vortices_now, window.late);
  for (const auto& [name, count] : causes(status)) line += fmt::format(" {}={}", name, count);
  if (status.recording)
    line += fmt::format(" recorded={} recording_stopped={}", status.counts.recorder.recorded,
                        status.counts.recorder.stopped);
  return line;
}

std::string status_json(const StatusSnapshot& status, const DaemonFacts& facts) {
  const DaemonCounts& counts = status.counts;
  const FrameCounts& frames = counts.frames;
  const StatusWindow& window = status.window;
  nlohmann::ordered_json json;
  json["program"] = kProgram;
  json["config_hash"] = facts.config_hash;
  json["camera"] = facts.camera;
  json["uptime_s"] = status.uptime_s;
  json["state"] = name_of(status.state);
  json["reason"] = status.reason;
  json["results"] = status.results;
  json["newest_age_s"] = age_s(status.newest_ns);
  json["n_valid"] = window.valid_now;
  json["n_lost"] = window.lost_now;
  json["n_vortices"] = window.vortices_now;
  const std::optional<double> mean_life_s = status.tracks.mean_life_s();
  json["tracks_now"] = status.tracks.now;
  json["tracks_begun"] = status.tracks.begun;
  json["mean_track_life_s"] = mean_life_s ? nlohmann::json(*mean_life_s) : nlohmann::json(nullptr);
  // What the last second was like; null where it brought nothing.
  const bool seen = window.frames > 0;
  const auto if_seen = [&](double value) {
    return seen ? nlohmann::json(value) : nlohmann::json(nullptr);
  };
  json["frames_per_s"] = window.frames_per_s();
  json["p50_us"] = if_seen(microseconds(window.p50_ns));
  json["p99_us"] = if_seen(microseconds(window.p99_ns));
  json["max_us"] = if_seen(microseconds(window.max_ns));
  json["late"] = window.late;
  json["delivered"] = frames.delivered;
  json["superseded"] = counts.superseded;
  json["unprocessed"] = counts.unprocessed;
  json["lost"] = frames.lost;
  json["no_buffer"] = frames.no_buffer;
  json["incomplete"] = frames.incomplete;
  json["timed_out"] = frames.timed_out;
  json["aborted"] = frames.aborted;
  json["wrong_size"] = frames.wrong_size;
  json["other"] = frames.other;
  json["dropped"] = frames.dropped();
  json["refused_packets"] = frames.refused_packets;
  json["connections"] = counts.connections;
  json["recording"] = status.recording && !counts.recorder.stopped && !status.recording_paused;
  json["recorded"] = counts.recorder.recorded;
  json["unrecorded"] = counts.recorder.dropped;
  json["files"] = counts.recorder.files;
  json["recording_stopped"] = counts.recorder.stopped;
  json["free_mb"] = facts.free_mb ? nlohmann::json(*facts.free_mb) : nlohmann::json(nullptr);
  if (!facts.calibration.empty()) json["calibration"] = facts.calibration;
  if (status.beam) {
    json["beam"] = beam_json(status.beam->figures, status.beam->pitch_m);
    json["beam"]["warning"] = status.beam->warning;
  }
  if (status.air) json["air"] = air_json(*status.air);
  // The reason may hold a camera's name for itself, which need not be UTF-8.
  return json.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

StatusPrinter::StatusPrinter() : terminal_(isatty(STDOUT_FILENO) == 1) {}

void StatusPrinter::add(const StatusSnapshot& status) {
  if (terminal_) {
    std::puts(status_line(status).c_str());
    std::fflush(stdout);
  } else if (++seconds_ % kSecondsALogLine == 0) {
    spdlog::info("{}", status_fields(status));
  }
}

}  // namespace curlew
