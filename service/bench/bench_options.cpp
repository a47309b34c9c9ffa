#include "service/bench/bench_options.h"

#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

#include "core/error.h"
#include "service/bench/bench_comparison.h"

namespace curlew {

void BenchSize::add_lenslets_to(CLI::App& command) {
  command.add_option("--rows", one.rows, "lenslet rows")->check(CLI::Range(2, 1000));
  command.add_option("--cols", one.cols, "lenslet columns")->check(CLI::Range(2, 1000));
}

void BenchSize::add_windows_to(CLI::App& command) {
  add_lenslets_to(command);
  command.add_option("--window", one.window_px, "pixels per lenslet side")
      ->check(CLI::Range(2, 1000));
}

std::vector<BenchCase> BenchSize::window_cases() const {
  if (one.rows == 0 && one.cols == 0 && one.window_px == 0)
    return {kBenchCases.begin(), kBenchCases.end()};
  if (one.rows == 0 || one.cols == 0 || one.window_px == 0)
    throw UsageError("give --rows, --cols and --window together");
  return {one};
}

std::vector<BenchCase> BenchSize::lenslet_cases(const std::vector<BenchCase>& standard) const {
  if (one.rows == 0 && one.cols == 0) return standard;
  if (one.rows == 0 || one.cols == 0) throw UsageError("give --rows and --cols together");
  return {one};
}

void BenchRounds::add_to(CLI::App& command) {
  command.add_option("--rounds", rounds, "times that each is measured, in turn with the others")
      ->check(CLI::Range(1, 1000000))
      ->capture_default_str();
  command.add_flag("--quick", quick, "3 rounds: shows that all runs");
  output.add_to(command);
}

void BenchOutput::add_to(CLI::App& command) {
  command.add_flag("--json", json, "print JSON");
  command.add_option("--compare", compare,
                     "a file that --json made earlier: say which figures have changed since, and "
                     "which differ no more than they do by themselves");
}

void BenchOutput::print(nlohmann::ordered_json figures, const std::string& text) const {
  std::string more;
  if (!compare.empty()) {
    const std::vector<ComparedFigure> compared = compare_figures(read_figures(compare), figures);
    if (compared.empty())
      throw Failure(compare +
                    " has no figure that this benchmark has: give what the same command "
                    "printed with --json, of the same sizes");
    figures["compared"] = comparison_json(compared);
    more = comparison_text(compared);
  }
  if (json)
    fmt::print("{}\n", figures.dump(2));
  else
    fmt::print("{}{}", text, more);
}

int BenchRounds::count() const { return quick ? std::min(rounds, 3) : rounds; }

}  // namespace curlew
