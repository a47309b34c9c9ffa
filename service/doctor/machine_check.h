// Checks whether the machine is fit for real time, and says what would make it so.
#pragma once

#include <array>
#include <string>
#include <string_view>
#include <vector>

#include "service/config.h"

namespace curlew {

enum class CheckVerdict {
  kGood,
  kCouldBeBetter,  ///< it works, with more jitter or less reserve than need be
  kBad,            ///< real time cannot be relied on
  kNotSeen,        ///< the kernel does not show it here, as in a virtual machine or a container
};
constexpr std::array<std::string_view, 4> kVerdictWords = {"good", "could be better", "bad",
                                                           "not seen"};
constexpr std::string_view word_of(CheckVerdict verdict) {
  return kVerdictWords[static_cast<std::size_t>(verdict)];
}

struct Check {
  std::string name;
  CheckVerdict verdict = CheckVerdict::kGood;
  std::string found;                  ///< what was found
  std::string advice;                 ///< what to change, in words; empty: nothing
  std::vector<std::string> commands;  ///< what to type into a shell for that
};

/// The machine that is checked.
struct Machine {
  /// Prefix of every path of /proc, /sys and /dev: "" for this machine, a folder for a made-up one.
  std::string root;
  Config config;
  std::string build_type;  ///< the program's build type, as CMake calls it
};

/// Makes all checks, in the order in which they are shown. Nothing that it finds or does not find
/// makes it throw.
std::vector<Check> check_machine(const Machine& machine);

/// Returns whether no check is bad.
bool ready_for_real_time(const std::vector<Check>& checks);

}  // namespace curlew
