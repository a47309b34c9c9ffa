// This benchmark times how long it takes from the last row of a frame to its vortices if the work
// follows the readout, and if it begins with the whole frame.
#pragma once

#include "service/bench/bench_frames.h"
#include "service/bench/timed_rounds.h"

namespace curlew {

struct StreamBenchmark {
  BenchCase which;
  int rows_at_once = 0;   ///< rows of the frame that arrive together
  RoundTimes whole;       ///< from the last row to the list of vortices, for whole frames
  RoundTimes streamed;    ///< the same if the rows before were worked on as they came
  RoundTimes ahead;       ///< all that was done before the last rows
  RoundTimes slowest;     ///< the longest that was done between two announcements of rows
  RoundTimes read;        ///< the sum of the frame's pixels
  RoundTimes plain_rows;  ///< flux and centre of gravity by whole rows in C
  bool same = true;       ///< whether both gave the same bits in every round
};

/// Times one case, by circulation, in one thread: the rows are there when they are asked for. The
/// frames show one wavefront, so that no window moves, differ by their noise, and come from beyond
/// the second cache.
StreamBenchmark time_stream(const BenchCase& which, int rounds);

}  // namespace curlew
