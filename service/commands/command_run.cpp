#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <memory>

#include "core/error.h"
#include "service/commands/air_flags.h"
#include "service/commands/commands.h"
#include "service/commands/page_flag.h"
#include "service/commands/pipeline_flags.h"
#include "service/daemon/daemon.h"
#include "service/program/interrupt.h"
#include "service/program/log.h"
#include "service/results/latency_report.h"

namespace curlew {
namespace {

struct RunCommand {
  PipelineFlags pipeline;
  std::string camera;
  std::string sensor;
  std::string jsonl;
  std::string page;
  bool watch = false;
  DaemonLimits limits;
  AirOptions air;
};

/// Returns the configuration. The file is read again at every reload.
Config configuration(const RunCommand& options) {
  Config config = options.pipeline.configuration();
  if (!options.camera.empty()) config.camera.source = options.camera;
  if (!options.sensor.empty()) config.daemon.sensor = options.sensor;
  if (!options.jsonl.empty()) config.daemon.jsonl = options.jsonl;
  if (!options.page.empty()) config.page.listen = options.page;
  return config;
}

void print_report(const DaemonReport& report) {
  const FrameCounts& frames = report.frames;
  fmt::print("{} frames delivered = {} results + {} superseded + {} not processed at the end\n",
             frames.delivered, report.results.frames, report.superseded, report.unprocessed);
  fmt::print(
      "not delivered: {} lost ({} for want of a buffer), {} incomplete, {} timed out, "
      "{} aborted, {} of the wrong size, {} other\n",
      frames.lost, frames.no_buffer, frames.incomplete, frames.timed_out, frames.aborted,
      frames.wrong_size, frames.other);
  if (frames.refused_packets > 0)
    fmt::print("{} packets refused: others sent them, they were malformed, or there was no room\n",
               frames.refused_packets);
  fmt::print("{}, {} results after the deadline, {} connections to the camera\n",
             found_text(report.results), report.results.late, report.connections);
  if (report.recorder.files > 0 || report.recorder.dropped > 0)
    fmt::print("recorded {} frames in {} files, {} frames dropped\n", report.recorder.recorded,
               report.recorder.files, report.recorder.dropped);
  if (const std::string text = followed_text(report.results); !text.empty())
    fmt::print("{}\n", text);
  for (const std::string& text : doubts(report.results)) fmt::print("{}\n", text);
  if (report.unwritten > 0) fmt::print("{} results not written as JSON\n", report.unwritten);
  fmt::print("\n{}", latency_table(report.results));
}

void run_daemon(const RunCommand& options) {
  catch_daemon_signals();
  const Config config = configuration(options);
  const Log log(config.daemon.log_level);
  Daemon daemon([options] { return configuration(options); }, options.limits, options.air,
                options.watch);
  const DaemonReport report = daemon.run();
  print_report(report);
  if (const std::string why = nothing_measured(report.results); !why.empty()) throw Failure(why);
  // Whoever ends it by a signal may not have waited for a frame.
  if (report.results.frames == 0 && !interrupted())
    throw Failure("nothing was measured: no frame came from " + config.camera.source);
}

}  // namespace

void add_run(CLI::App& app) {
  auto options = std::make_shared<RunCommand>();
  CLI::App* command = app.add_subcommand("run", "Watch a camera: the daemon");
  command->add_option(
      "--camera", options->camera,
      "camera: aravis:ID (or aravis: for the only one), usb:VID:PID, isio:NAME, sim:PRESET or "
      "file:RECORDING.fits");
  command->add_option("--sensor", options->sensor,
                      "sensor file made by 'curlew calibrate'; sim: needs none");
  command->add_option("--frames", options->limits.frames, "how many results to end after")
      ->check(CLI::Range(std::int64_t{1}, std::int64_t{1} << 62));
  command->add_option("--seconds", options->limits.seconds, "how long to run, s")
      ->check(CLI::Range(0.001, 1e9));
  command->add_option(
      "--jsonl", options->jsonl,
      "file to which one JSON object a frame is appended, a pipe, or - for standard output");
  add_page_flag(*command, options->page);
  command->add_flag("--watch", options->watch,
                    "show spots, phase and vortices on this terminal, which needs 24-bit colours");
  options->pipeline.add_to(*command);
  add_air_flags(*command, options->air);
  command->callback([options] { run_daemon(*options); });
}

}  // namespace curlew
