// Two runs of one benchmark are compared here: which figures have changed, and which differ no more
// than they do by themselves.
#pragma once

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

namespace curlew {

enum class FigureChange : std::uint8_t {
  kSame,    ///< the runs differ no more than the parts of a run do among themselves
  kFaster,  ///< than before
  kSlower,
  kUnsure,  ///< a run is too short to tell
};

/// A figure that two runs share.
struct ComparedFigure {
  std::string name;  ///< its way through the JSON, as "cases 80 80 10 u16 / cold / kernel"
  double before_us = 0.0;
  double now_us = 0.0;
  /// Now over before. Both are in units of a read of the frame in the same run, where the benchmark
  /// times one, so that a machine that has become slower as a whole changes nothing.
  double ratio = 1.0;
  bool over_read = false;  ///< whether that unit was at hand
  FigureChange change = FigureChange::kSame;
};

/// Compares all timed figures that both runs have. A run is cut into kTimedParts parts. A figure
/// has changed if its ratio differs from 1 by more than 3 %, and if the parts of one run all lie
/// beyond those of the other, the lowest and the highest part of each left out.
std::vector<ComparedFigure> compare_figures(const nlohmann::ordered_json& before,
                                            const nlohmann::ordered_json& now);

/// Returns the figures of a file that a benchmark wrote as JSON. Throws Failure, which names the
/// file, if it is something else.
nlohmann::ordered_json read_figures(const std::string& path);

nlohmann::ordered_json comparison_json(const std::vector<ComparedFigure>& compared);
std::string comparison_text(const std::vector<ComparedFigure>& compared);

}  // namespace curlew
