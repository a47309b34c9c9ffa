#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>

#include "acquisition/list_cameras.h"
#include "service/commands/commands.h"

namespace curlew {
namespace {

void print_cameras() {
  const std::vector<CameraListing> cameras = list_cameras();
  if (cameras.empty())
    fmt::print(
        "no camera found; 'curlew doctor' checks network and USB, and sim:PRESET needs none\n");
  for (const CameraListing& camera : cameras) {
    fmt::print("{:<32} {}\n", camera.source, camera.description);
    if (!camera.problem.empty()) fmt::print("    {}\n", camera.problem);
  }
}

}  // namespace

void add_cameras(CLI::App& app) {
  CLI::App* command = app.add_subcommand("cameras", "List the cameras that are attached");
  command->callback(print_cameras);
}

}  // namespace curlew
