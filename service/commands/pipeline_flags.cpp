#include "service/commands/pipeline_flags.h"

#include <CLI/CLI.hpp>

#include "core/error.h"
#include "service/method_choice.h"

namespace curlew {

void PipelineFlags::add_to(CLI::App& command) {
  command.add_option("--config", config, "configuration (TOML); 'run' reads it again at SIGHUP");
  command.add_option("--method", method,
                     "how vortices are found: auto (default: the best that the sensor allows), "
                     "circulation, whitened or classifier");
  command.add_flag("--track", track,
                   "follow vortices from frame to frame and report those that last");
  command.add_option("--false-alarms", false_alarms,
                     "false alarms a frame to accept where there is only noise (default 0.01)");
  command.add_option(
      "--threads", threads,
      "all stages on one thread (inline, default) or shared by a team of them (team)");
}

Config PipelineFlags::configuration() const {
  Config settings = config.empty() ? Config{} : read_config(config);
  if (!threads.empty()) settings.pipeline.threads = setting_from<Threading>(threads, "--threads");
  if (!method.empty()) settings.detect.method = setting_from<DetectMethod>(method, "--method");
  settings.track.enabled |= track;
  if (false_alarms) settings.detect.false_alarms_per_frame = *false_alarms;
  if (false_alarms && settings.detect.method == DetectMethod::kClassifier)
    throw UsageError(
        "--false-alarms has no effect on the method classifier: take circulation or whitened, or "
        "set [detect] min_probability");
  refuse_settings_without_effect(settings);
  return settings;
}

}  // namespace curlew
