// The options of `run` and `replay` that concern the air.
#pragma once

#include <CLI/CLI.hpp>

#include "reconstruct/air/air_options.h"

namespace curlew {

inline void add_air_flags(CLI::App& command, AirOptions& air) {
  auto* window = command
                     .add_option("--air", air.window_s,
                                 "estimate the air (r0, scintillation, wind) over so many seconds "
                                 "at a time, or frames where no clock is known")
                     ->check(CLI::Range(1e-3, 1e6));
  command
      .add_option("--fresnel", air.fresnel_pitches,
                  "square root of wavelength times path, in pitches at the lenslets, of a path "
                  "through even air; 0: the air is near")
      ->check(CLI::Range(0.0, 1e4))
      ->needs(window);
}

}  // namespace curlew
