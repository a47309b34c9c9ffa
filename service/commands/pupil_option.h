// The option --pupil of the commands that simulate.
#pragma once

#include <string>

#include "acquisition/simulator/simulator_options.h"

namespace CLI {
class App;
}

namespace curlew {

/// shape must live as long as the command.
void add_pupil_option(CLI::App& command, PupilShape& shape);

/// The word that --pupil takes for it.
std::string pupil_word(PupilShape shape);

}  // namespace curlew
