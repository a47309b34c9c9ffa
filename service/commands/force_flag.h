// The flag --force of the commands that write files.
#pragma once

#include <CLI/CLI.hpp>

#include "service/program/outputs.h"

namespace curlew {

/// Adds --force, by which outputs that exist already are replaced.
inline void add_force_flag(CLI::App& command, Existing& existing) {
  command.add_flag_callback(
      "--force", [&existing] { existing = Existing::kReplaced; },
      "replace outputs that exist already");
}

}  // namespace curlew
