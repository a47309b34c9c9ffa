// The machine under the program: is it fit for real time, and if not, what would make it so.
#pragma once

#include <array>
#include <string>
#include <string_view>
#include <vector>

#include "service/config.h"

namespace curlew {

enum class Verdict {
  kGood,
  kCouldBeBetter,  ///< works, with more jitter or less reserve than need be
  kBad,            ///< real time cannot be relied on
  kNotSeen,        ///< the kernel does not show it here: a virtual machine, a container
};
constexpr std::array<std::string_view, 4> kVerdictWords = {"good", "could be better", "bad",
                                                           "not seen"};
constexpr std::string_view word_of(Verdict verdict) {
  return kVerdictWords[static_cast<std::size_t>(verdict)];
}

struct Check {
  std::string name;
  Verdict verdict = Verdict::kGood;
  std::string found;                  ///< what is so
  std::string advice;                 ///< what to change, in words; empty: nothing
  std::vector<std::string> commands;  ///< what to type for it, in a shell
};

/// What the machine is asked for by the checks.
struct Machine {
  /// Before every path of /proc, /sys and /dev: "" for this machine, a folder for a made-up one.
  std::string root;
  Config config;
  std::string build_type;  ///< of the program, as CMake calls it
};

/// All checks, in the order they are shown. Never throws for what it finds or does not find.
std::vector<Check> check_machine(const Machine& machine);

/// No check is bad.
bool ready_for_real_time(const std::vector<Check>& checks);

}  // namespace curlew
