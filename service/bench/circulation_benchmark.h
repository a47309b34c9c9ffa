// This benchmark times how vortices are found by circulation, which takes longer the more there
// are.
#pragma once

#include <cstddef>

#include "service/bench/timed_rounds.h"

namespace curlew {

struct CirculationBenchmark {
  int rows = 0;
  int cols = 0;
  int vortices = 0;       ///< how many were put in
  std::size_t found = 0;  ///< how many were found, false ones too
  RoundTimes circulate;   ///< circulate(): slopes to circulations
  RoundTimes find;        ///< find_circulation_vortices(): circulations to vortices
  RoundTimes both;
};

/// Times rows × cols valid lenslets with slope noise of .2 rad a pitch and round vortices of either
/// charge anywhere, on the same frame again and again.
CirculationBenchmark time_circulation(int rows, int cols, int vortices, int rounds);

}  // namespace curlew
