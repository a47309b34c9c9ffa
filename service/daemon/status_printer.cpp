#include "service/daemon/status_printer.h"

#include <spdlog/spdlog.h>
#include <unistd.h>

#include <array>
#include <cstdio>
#include <utility>

namespace curlew {
namespace {

constexpr int kSecondsALogLine = 10;

double microseconds(std::int64_t ns) { return static_cast<double>(ns) * 1e-3; }

/// Every way a frame can fail to become a result, by name.
std::array<std::pair<const char*, std::int64_t>, 8> causes(const DaemonStatus& status) {
  const FrameCounts& frames = status.frames;
  return {{{"lost", frames.lost},
           {"incomplete", frames.incomplete},
           {"timed_out", frames.timed_out},
           {"aborted", frames.aborted},
           {"wrong_size", frames.wrong_size},
           {"other", frames.other},
           {"superseded", status.superseded},
           {"unrecorded", status.recorder.dropped}}};
}

}  // namespace

std::string status_line(const DaemonStatus& status) {
  const StatusWindow& window = status.window;
  std::string line = fmt::format("{:<9} {:>8.1f} frames/s", status.state, status.frames_per_s);
  if (window.frames > 0)
    line += fmt::format("  p50 {:.0f} p99 {:.0f} max {:.0f} µs  vortices {}",
                        microseconds(window.p50_ns), microseconds(window.p99_ns),
                        microseconds(window.max_ns), window.vortices_now);
  if (window.late > 0) line += fmt::format("  late {}", window.late);
  for (const auto& [name, count] : causes(status))
    if (count > 0) line += fmt::format("  {} {}", name, count);
  if (status.recording)
    line += status.recorder.stopped ? "  recording stopped"
                                    : fmt::format("  recorded {}", status.recorder.recorded);
  return line;
}

std::string status_fields(const DaemonStatus& status) {
  const StatusWindow& window = status.window;
  std::string line = fmt::format(
      "state={} results={} frames_per_s={:.1f} p50_us={:.1f} p99_us={:.1f} max_us={:.1f} "
      "vortices={} late={}",
      status.state, status.results, status.frames_per_s, microseconds(window.p50_ns),
      microseconds(window.p99_ns), microseconds(window.max_ns), window.vortices_now, window.late);
  for (const auto& [name, count] : causes(status)) line += fmt::format(" {}={}", name, count);
  if (status.recording)
    line += fmt::format(" recorded={} recording_stopped={}", status.recorder.recorded,
                        status.recorder.stopped);
  return line;
}

StatusPrinter::StatusPrinter() : terminal_(isatty(STDOUT_FILENO) == 1) {}

void StatusPrinter::add(const DaemonStatus& status) {
  if (terminal_) {
    std::puts(status_line(status).c_str());
    std::fflush(stdout);
  } else if (++seconds_ % kSecondsALogLine == 0) {
    spdlog::info("{}", status_fields(status));
  }
}

}  // namespace curlew
