#include "service/daemon/status_printer.h"

#include <spdlog/spdlog.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <utility>

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
  for (const auto& [name, count] : causes(status))
    if (count > 0) line += fmt::format("  {} {}", name, count);
  if (status.recording)
    line += status.counts.recorder.stopped
                ? "  recording stopped"
                : fmt::format("  recorded {}", status.counts.recorder.recorded);
  return line;
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

std::string status_json(const StatusSnapshot& status) {
  const DaemonCounts& counts = status.counts;
  nlohmann::ordered_json json;
  json["state"] = name_of(status.state);
  json["reason"] = status.reason;
  json["results"] = status.results;
  json["frames_per_s"] = status.window.frames_per_s();
  json["n_valid"] = status.window.valid_now;
  json["n_lost"] = status.window.lost_now;
  json["delivered"] = counts.frames.delivered;
  json["superseded"] = counts.superseded;
  json["lost"] = counts.frames.lost;
  json["incomplete"] = counts.frames.incomplete;
  json["timed_out"] = counts.frames.timed_out;
  json["aborted"] = counts.frames.aborted;
  json["wrong_size"] = counts.frames.wrong_size;
  json["other"] = counts.frames.other;
  json["dropped"] = counts.frames.dropped();
  json["refused_packets"] = counts.frames.refused_packets;
  json["connections"] = counts.connections;
  json["recording"] = status.recording && !counts.recorder.stopped && !status.recording_paused;
  json["recorded"] = counts.recorder.recorded;
  json["unrecorded"] = counts.recorder.dropped;
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
