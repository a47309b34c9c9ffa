// What a benchmark is held against, on frames that take turns: plain loops in C, and a read of the
// frame.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "acquisition/loop_source.h"
#include "centroiding/sensor.h"
#include "core/frame.h"
#include "core/image.h"
#include "service/bench/bench_frames.h"
#include "service/bench/plain_centroid.h"

namespace curlew {

/// Returns how many bytes the second cache holds. It is a guess if the system does not say.
std::size_t second_cache_bytes();

/// Holds frames of one case, and knows whose turn it is. All frames together are more than twice
/// the second cache.
class FrameRotation {
 public:
  FrameRotation(const BenchCase& which, PixelType pixel_type, BenchSlopes slopes);
  /// Makes frames of u16 pixels that show one smooth wavefront and differ by their noise.
  static FrameRotation of_one_wavefront(const BenchCase& which);

  const FrameFormat& format() const { return format_; }
  std::size_t size() const { return frames_.size(); }
  void advance() { current_ = (current_ + 1) % frames_.size(); }
  FrameBuffer& current() const { return *frames_[current_]; }
  /// Returns a source of the first n frames, or of all if there are fewer, over and over.
  LoopSource loop(std::size_t n, std::int64_t count) const;

 private:
  FrameFormat format_;
  std::vector<std::shared_ptr<FrameBuffer>> frames_;
  std::size_t current_ = 0;
};

/// Holds the maps that plain loops take, in the order of the frame's pixels.
struct PlainMaps {
  /// Makes them from the sensor's dark, flat and bad pixels, which must be there. threshold_adu is
  /// above the dark.
  PlainMaps(const Sensor& sensor, const FrameFormat& format, double threshold_adu);

  Image<float> gain;    ///< [rows, cols] of pixels
  Image<float> offset;  ///< the same, counts
};

/// Runs the plain loops over one case's frames.
template <typename Pixel>
class PlainLoops {
 public:
  PlainLoops(const BenchCase& which, const FrameRotation& frames, const PlainMaps& maps)
      : which_(which),
        frames_(frames),
        maps_(maps),
        x_(which.rows, which.cols),
        y_(x_),
        flux_(x_),
        column_sum_(2, which.cols * which.window_px) {}

  void find(PlainBuild build, PlainOrder order) {
    const PlainFrame<Pixel> frame{.rows = which_.rows,
                                  .cols = which_.cols,
                                  .window_px = which_.window_px,
                                  .pixels = frames_.current().view().template data<Pixel>(),
                                  .gain = maps_.gain.data(),
                                  .offset = maps_.offset.data()};
    find_plain_centroids(build, order, frame,
                         {x_.data(), y_.data(), flux_.data(), column_sum_.data()});
  }
  void read(PlainBuild build) {
    sum_ = sum_pixels(build, frames_.current().view().template data<Pixel>(),
                      static_cast<std::int64_t>(frames_.format().pixels()));
  }

 private:
  const BenchCase& which_;
  const FrameRotation& frames_;
  const PlainMaps& maps_;
  Image<float> x_;
  Image<float> y_;
  Image<float> flux_;
  Image<float> column_sum_;
  volatile std::uint64_t sum_ = 0;  // keeps the compiler from leaving the reading out
};

/// Returns the build that is fastest when nothing disturbs it, which the first tenth of the rounds
/// shows. It need not be the one of the widest vectors: they do not suit windows of a few pixels.
PlainBuild fastest_build(int rounds, const std::function<void(PlainBuild)>& run);

}  // namespace curlew
