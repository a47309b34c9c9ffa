// This benchmark times the pipeline's stage from pixels to centroids, beside plain loops in C and
// beside only reading the frame, all in the same rounds.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "core/frame.h"
#include "service/bench/bench_frames.h"
#include "service/bench/plain_centroid.h"
#include "service/bench/timed_rounds.h"

namespace curlew {

/// Says how long one frame takes.
struct CentroidTimes {
  RoundTimes curlew;  ///< the stage with windows that stay: level, sharp pixels and kernel
  /// The stage as the pipeline runs it by default, with windows that follow. The frames' spots are
  /// displaced at random, so that many windows are centred on theirs and measured again.
  RoundTimes following;
  /// find_centroids() alone, at the calibration's level: dark, flat, bad pixels, threshold, moments
  /// to second order and variances.
  RoundTimes kernel;
  RoundTimes kernel_by_windows;    ///< the same with each window measured by itself
  RoundTimes kernel_tilted;        ///< the same for rows of windows that are tilted by 1°
  RoundTimes kernel_without_maps;  ///< the same for a sensor without dark, flat and bad pixels
  RoundTimes plain_windows;        ///< PlainOrder::kWindows, with the maps
  RoundTimes plain_rows;           ///< PlainOrder::kRows, with the maps
  RoundTimes read;                 ///< the sum of all pixels
};

struct CentroidBenchmark {
  BenchCase which;
  PixelType pixel_type = PixelType::kU16;
  std::size_t frame_bytes = 0;
  // These builds of the plain loops were timed, because they are the fastest in this case.
  PlainBuild windows_build = PlainBuild::kPortable;
  PlainBuild rows_build = PlainBuild::kPortable;
  PlainBuild read_build = PlainBuild::kPortable;
  /// The same frame again and again. Each run comes straight after the same run, so that the caches
  /// hold all that they can.
  CentroidTimes warm;
  /// Every run takes another frame. Between two uses of one frame, others of twice the second
  /// cache's size are read, so that it comes from further away, as a camera's newest frame does.
  CentroidTimes cold;
  int cold_frames = 0;  ///< how many frames take turns
};

/// Times one case on frames as bench_pixels() makes them.
CentroidBenchmark time_centroids(const BenchCase& which, PixelType pixel_type, int rounds);

/// Says what one of the centroid methods costs on a u16 frame without maps.
struct CentroidMethodTimes {
  std::string method;
  RoundTimes times;
};

/// Times all methods that take the case's windows, on the same frame again and again. The first is
/// kThresholded.
std::vector<CentroidMethodTimes> time_centroid_methods(const BenchCase& which, int rounds);

}  // namespace curlew
