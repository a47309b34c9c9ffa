// The options that `run` and `replay` share.
#pragma once

#include <optional>
#include <string>

#include "service/config.h"

namespace CLI {
class App;
}

namespace curlew {

/// What the command line says about the pipeline. It goes before the configuration file.
struct PipelineFlags {
  std::string config;  ///< the configuration file; empty: none
  std::string threads;
  std::string method;
  bool track = false;
  std::optional<double> false_alarms;

  /// Adds the options to a command. This object must live as long as the command.
  void add_to(CLI::App& command);

  /// Reads the file and puts what the command line says over it. Throws UsageError as read_config()
  /// does, and for a word that a setting does not know and for settings
  /// of [detect] without effect.
  Config configuration() const;
};

}  // namespace curlew
