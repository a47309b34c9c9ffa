// What all benchmarks on simulated fields share: where fields are kept, and how the benchmarks run.
#pragma once

#include <cstdint>
#include <string>

#include "service/bench/detection_dataset.h"
#include "service/program/progress.h"

namespace CLI {
class App;
}

namespace curlew {

struct BenchRun {
  std::string cache = default_realisation_folder();
  bool no_cache = false;
  bool quick = false;
  bool json = false;

  /// Returns the folder in which fields are kept; empty: they are not kept.
  std::string folder() const { return no_cache ? std::string() : cache; }

  /// Adds --quick, --cache, --no-cache, --threads and --json. quick_text: what --quick does.
  void add_to(CLI::App& command, const std::string& quick_text, int& threads);

  /// Returns what work(step) returns, and shows a progress bar of n steps. step() throws Failure if
  /// the user has asked to stop.
  template <class Work>
  auto watch(const char* what, std::int64_t n, Work work) const {
    Progress progress(what, n);
    return work([&] {
      progress.step();
      check_interrupt();
    });
  }

 private:
  void check_interrupt() const;
};

/// Throws Failure if this is a debug build.
void refuse_debug_build();

}  // namespace curlew
