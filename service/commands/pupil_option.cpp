#include "service/commands/pupil_option.h"

#include <CLI/CLI.hpp>
#include <map>

namespace curlew {
namespace {

const std::map<std::string, PupilShape> kPupils{{"square", PupilShape::kSquare},
                                                {"round", PupilShape::kRound},
                                                {"obscured", PupilShape::kObscured}};

}  // namespace

void add_pupil_option(CLI::App& command, PupilShape& shape) {
  command
      .add_option("--pupil", shape,
                  "which lenslets get light: square (default, all), round or obscured")
      ->transform(CLI::CheckedTransformer(kPupils));
}

std::string pupil_word(PupilShape shape) {
  for (const auto& [word, known] : kPupils)
    if (known == shape) return word;
  return {};
}

}  // namespace curlew
