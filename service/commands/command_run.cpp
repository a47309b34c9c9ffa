#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>
#include <optional>

#include "core/error.h"
#include "service/commands/commands.h"
#include "service/daemon/control_socket.h"
#include "service/daemon/daemon.h"
#include "service/program/interrupt.h"
#include "service/program/log.h"
#include "service/results/latency_report.h"

namespace curlew {
namespace {

struct RunCommand {
  std::string config;
  std::string camera;
  std::string sensor;
  std::string jsonl;
  std::string threads;
  std::string method;
  bool track = false;
  std::optional<double> false_alarms;
  DaemonLimits limits;
};

/// The file, and over it what the command line says. Read again at every reload.
Config configuration(const RunCommand& options) {
  Config config = options.config.empty() ? Config{} : read_config(options.config);
  if (!options.camera.empty()) config.camera.source = options.camera;
  if (!options.sensor.empty()) config.daemon.sensor = options.sensor;
  if (!options.jsonl.empty()) config.daemon.jsonl = options.jsonl;
  if (!options.threads.empty())
    config.pipeline.threads = setting_from<Threading>(options.threads, "--threads");
  if (!options.method.empty())
    config.detect.method = setting_from<DetectMethod>(options.method, "--method");
  config.track.enabled |= options.track;
  if (options.false_alarms) config.detect.false_alarms_per_frame = *options.false_alarms;
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
  fmt::print("{} vortices, {} results after the deadline, {} connections to the camera\n",
             report.results.vortices, report.results.late, report.connections);
  if (report.recorder.files > 0)
    fmt::print("recorded {} frames in {} files, {} frames dropped\n", report.recorder.recorded,
               report.recorder.files, report.recorder.dropped);
  if (report.unwritten > 0) fmt::print("{} results not written as JSON\n", report.unwritten);
  fmt::print("\n{}", latency_table(report.results));
}

void run_daemon(const RunCommand& options) {
  catch_daemon_signals();
  const Log log(configuration(options).daemon.log_level);
  Daemon daemon([options] { return configuration(options); }, options.limits);
  print_report(daemon.run());
}

}  // namespace

void add_run(CLI::App& app) {
  auto options = std::make_shared<RunCommand>();
  CLI::App* command = app.add_subcommand("run", "Watch a camera: the daemon");
  command->add_option("--config", options->config, "configuration (TOML); read again at SIGHUP");
  command->add_option("--camera", options->camera,
                      "aravis:ID (or aravis: for the only one), usb:VID:PID, sim:PRESET or "
                      "file:RECORDING.fits");
  command->add_option("--sensor", options->sensor,
                      "sensor file made by 'curlew calibrate'; sim: needs none");
  command->add_option("--frames", options->limits.frames, "end after so many results")
      ->check(CLI::Range(std::int64_t{1}, std::int64_t{1} << 62));
  command->add_option("--seconds", options->limits.seconds, "end after so long")
      ->check(CLI::Range(0.001, 1e9));
  command->add_option("--jsonl", options->jsonl, "append one JSON object a frame");
  command->add_option("--threads", options->threads, "inline (default) or per_stage");
  command->add_option("--method", options->method,
                      "how vortices are found: circulation (default), whitened or classifier");
  command->add_flag("--track", options->track,
                    "follow vortices from frame to frame, and report what lasts");
  command->add_option("--false-alarms", options->false_alarms,
                      "vortices reported a frame where there is only noise (default 0.01)");
  command->callback([options] { run_daemon(*options); });
}

void add_control(CLI::App& app) {
  struct Question {
    std::string word;
    std::string socket = "/run/curlew/control";
  };
  auto question = std::make_shared<Question>();
  CLI::App* command = app.add_subcommand("control", "Ask or tell the running daemon");
  command
      ->add_option("word", question->word,
                   "status (JSON), trigger (the recorder) or expose (a software-triggered camera)")
      ->required();
  command->add_option("--socket", question->socket, "as control in section [daemon]")
      ->capture_default_str();
  command->callback([question] {
    const std::string answer = ask_daemon(question->socket, question->word);
    if (answer.rfind("error: ", 0) == 0) throw Failure(answer.substr(7));
    fmt::print("{}\n", answer);
  });
}

}  // namespace curlew
