#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <memory>

#include "core/error.h"
#include "service/commands/commands.h"
#include "service/commands/force_flag.h"
#include "service/export/aot_export.h"
#include "service/program/outputs.h"

namespace curlew {

void add_export(CLI::App& app) {
  struct ExportOptions {
    AotInputs inputs;
    std::string out;
    Existing existing = Existing::kRefused;
    bool aot = false;
  };
  auto options = std::make_shared<ExportOptions>();
  CLI::App* command =
      app.add_subcommand("export", "Write results in an exchange format of the field");
  command
      ->add_option("results", options->inputs.results,
                   "results file by 'curlew replay --save slopes,flux'")
      ->required();
  command->add_flag("--aot", options->aot, "as AOT, adaptive-optics telemetry, version 2.0.0");
  command->add_option("--recording", options->inputs.recording, "the recording that was replayed")
      ->required();
  command->add_option("--sensor", options->inputs.sensor, "sensor file made by 'curlew calibrate'")
      ->required();
  command->add_option("--out", options->out, "file to write (FITS)")->required();
  add_force_flag(*command, options->existing);
  command->callback([options] {
    if (!options->aot) throw UsageError("say which format: --aot is the only one");
    check_output(options->out,
                 {options->inputs.results, options->inputs.recording, options->inputs.sensor},
                 options->existing);
    export_aot(options->inputs, options->out);
    fmt::print("{}\n", options->out);
  });
}

}  // namespace curlew
