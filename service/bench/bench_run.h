// What all benchmarks on simulated fields have in common: where fields are kept, how they are run.
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

  /// Where fields are kept; empty: nowhere.
  std::string folder() const { return no_cache ? std::string() : cache; }

  /// --quick, --cache, --no-cache, --threads, --json. quick_text: what --quick does.
  void add_to(CLI::App& command, const std::string& quick_text, int& threads);

  /// What work(step) returns, behind a progress bar of n steps. step() throws Failure where the
  /// user has asked to stop.
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

/// Throws Failure from a debug build.
void refuse_debug_build();

}  // namespace curlew
