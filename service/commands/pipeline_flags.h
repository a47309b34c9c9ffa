// The options that `run` and `replay` share.
#pragma once

#include <optional>
#include <string>

#include "service/config.h"

namespace CLI {
class App;
}

namespace curlew {

/// What the command line says of the pipeline, over the configuration file.
struct PipelineFlags {
  std::string config;  ///< the file; empty: none
  std::string threads;
  std::string method;
  bool track = false;
  std::optional<double> false_alarms;

  /// Adds the options to a command; this must live as long as the command.
  void add_to(CLI::App& command);

  /// The file, and over it what the command line says. UsageError as read_config(), and for a word
  /// that a setting does not know.
  Config configuration() const;
};

}  // namespace curlew
