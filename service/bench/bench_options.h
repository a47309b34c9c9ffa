// The options that benchmarks of single stages share say how large the frame is, how often to
// measure, and what to print.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "service/bench/bench_frames.h"

namespace CLI {
class App;
}

namespace curlew {

/// Holds --rows, --cols and --window. If none of them is given, the standard sizes are meant.
struct BenchSize {
  BenchCase one;  ///< as asked for; 0 where nothing was

  void add_lenslets_to(CLI::App& command);  ///< adds --rows and --cols
  void add_windows_to(CLI::App& command);   ///< adds --window, too
  /// Returns the case that was asked for, or else the standard ones. Throws UsageError if some of
  /// the options are given and others are missing.
  std::vector<BenchCase> window_cases() const;
  /// Does the same for benchmarks that begin with slopes and have no windows.
  std::vector<BenchCase> lenslet_cases(const std::vector<BenchCase>& standard) const;
};

/// Holds --json and --compare, which say how the figures of a benchmark are given.
struct BenchOutput {
  bool json = false;
  std::string compare;  ///< a file of earlier figures; empty: none

  void add_to(CLI::App& command);
  /// Prints the figures: `text`, or the JSON if that was asked for. What has changed since the
  /// earlier figures goes after the text, or into the JSON under "compared".
  void print(nlohmann::ordered_json figures, const std::string& text) const;
};

/// Holds --rounds and --quick, and the output.
struct BenchRounds {
  int rounds = 300;
  bool quick = false;
  BenchOutput output = {};

  void add_to(CLI::App& command);
  /// Returns how many rounds to run.
  int count() const;
};

}  // namespace curlew
