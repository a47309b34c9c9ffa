// What all benchmarks on simulated fields have in common: where fields are kept, how they are run.
#pragma once

#include <string>

#include "service/detection_dataset.h"

namespace CLI {
class App;
}

namespace curlew {

struct BenchRun {
  std::string cache = default_realisation_folder();
  bool no_cache = false;
  bool quick = false;
  bool json = false;

  /// Where fields are kept; empty: nowhere.
  std::string folder() const { return no_cache ? std::string() : cache; }

  /// --quick, --cache, --no-cache, --threads, --json. quick_text: what --quick does.
  void add_to(CLI::App& command, const std::string& quick_text, int& threads);

  /// Throws Failure where the user has asked to stop.
  void check_interrupt() const;
};

/// Throws Failure from a debug build.
void refuse_debug_build();

}  // namespace curlew
