// The option --pupil of the commands that simulate.
#pragma once

#include <string>

#include "acquisition/simulator/simulator_options.h"

namespace CLI {
class App;
}

namespace curlew {

/// Adds the option --pupil. shape must live as long as the command.
void add_pupil_option(CLI::App& command, PupilShape& shape);

/// Returns the word that --pupil takes for this shape.
std::string pupil_word(PupilShape shape);

}  // namespace curlew
