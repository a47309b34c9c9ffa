#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <memory>

#include "core/error.h"
#include "service/commands/commands.h"
#include "service/commands/force_flag.h"
#include "service/commands/night_merge.h"
#include "service/shards/merge.h"

namespace curlew {

void merge_night(const std::vector<std::string>& shards, const std::string& out,
                 Existing existing) {
  check_output(out, shards, existing);
  const MergeReport report = merge_shards(shards, out);
  fmt::print("{}: {} frames of {} shards, {} vortices\n", out, report.frames, report.shards,
             report.vortices);
  if (report.measured == 0)
    throw Failure(fmt::format("nothing was measured: no lenslet has a slope in any of {} frames",
                              report.frames));
}

void add_merge(CLI::App& app) {
  struct MergeOptions {
    std::vector<std::string> shards;
    std::string out;
    Existing existing = Existing::kRefused;
  };
  auto options = std::make_shared<MergeOptions>();
  CLI::App* command =
      app.add_subcommand("merge", "Put the shards of a night together, as one run had done it");
  command->add_option("shards", options->shards, "all files by 'curlew replay --shard', any order")
      ->required();
  command->add_option("--out", options->out, "results file to write (FITS)")->required();
  add_force_flag(*command, options->existing);
  command->callback([options] { merge_night(options->shards, options->out, options->existing); });
}

}  // namespace curlew
