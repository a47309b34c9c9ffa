// The benchmark of detection as files, so that anybody can enter a method of their own.
#pragma once

#include <functional>
#include <string>

#include "service/bench/detection_benchmark.h"

namespace curlew {

/// Writes the frozen frames of all cells into a folder: for each cell and subset a recording (or,
/// without noise, a cube of floats), the truth as CSV, and what `whitened` and `classifier` find as
/// examples of an entry; for each noise a reference and a dark; README.md; and score.py, which
/// gives for an entry the figures of `bench detect`. options.field and options.measurement say what
/// the sensor is. Throws Failure if the folder exists already, or a file cannot be written. step is
/// called as for run_detection_benchmark().
void export_detection_benchmark(const DetectionBenchmarkOptions& options,
                                const RealisationCache& cache, const std::string& folder,
                                const std::function<void()>& step);

/// The scorer in plain Python, and the text that explains it.
extern const char* const kExportedScorer;
extern const char* const kExportedReadme;

}  // namespace curlew
