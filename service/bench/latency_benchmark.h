// This benchmark times every stage of the pipeline, frame by frame, beside a read of the frame and
// a plain loop in C.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "service/bench/bench_frames.h"
#include "service/bench/timed_rounds.h"
#include "service/config.h"
#include "service/pipeline.h"

namespace curlew {

/// Says how long the stages take. The frames that they are given have just been copied.
struct LatencyTimes {
  std::array<RoundTimes, kStageCount> stage;
  RoundTimes total;       ///< from received to all results
  RoundTimes read;        ///< the sum of a frame's pixels
  RoundTimes plain_rows;  ///< flux and centre of gravity by whole rows in C, with the maps
};

struct LatencyBenchmark {
  BenchCase which;
  RunReport report;   ///< of the warm frames
  LatencyTimes warm;  ///< frames follow one another at once
  /// Between two frames memory of twice the second cache's size is read, as other programs do; read
  /// and plain_rows take frames that come from as far away.
  LatencyTimes cold;
};

struct LatencyOptions {
  std::int64_t frames = 2000;  ///< warm ones of each case; a fifth as many are cold
  DetectMethod method = DetectMethod::kCirculation;
  Threading threads = Threading::kInline;
  std::vector<int> cpus;
  double pace_hz = 0.0;  ///< of the warm frames; 0: each comes as soon as it is taken
};

/// Times all cases in turn, a tenth of the frames at a time, so that whatever else the machine does
/// falls on all of them alike. step is called now and then with how many frames were done since.
/// pinning gets a sentence on the CPUs used.
std::vector<LatencyBenchmark> time_latency(const std::vector<BenchCase>& cases,
                                           const LatencyOptions& options,
                                           const std::function<void(std::int64_t)>& step,
                                           std::string& pinning);

/// Returns how many frames time_latency() takes for each case.
std::int64_t frames_of_case(const LatencyOptions& options);

/// Returns 10, 20, 40, 80, 120, 160 and 200 lenslets squared, each with windows of window_px.
std::vector<BenchCase> scaling_cases(int window_px);

}  // namespace curlew
