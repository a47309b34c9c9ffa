// The frames on which centroid codes are compared: Gaussian spots of σ = P/6 px held within .9 and
// 2, peak 2000·exp(½N(0,1)) ADU up to 30000, displaced uniformly within ±P/8 px on both axes,
// background 100 ADU, Gaussian noise 3 ADU, no photon noise, u16.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "centroiding/sensor.h"
#include "core/frame.h"
#include "core/image.h"

namespace curlew {

inline constexpr double kBenchBackgroundAdu = 100.0;
inline constexpr double kBenchNoiseAdu = 3.0;
inline constexpr double kBenchThresholdAdu = 20.0;  ///< above the background

struct BenchCase {
  int rows = 0;  ///< lenslets
  int cols = 0;
  int window_px = 0;  ///< P
};
inline constexpr std::array<BenchCase, 3> kBenchCases = {{{40, 40, 6}, {80, 80, 10}, {30, 30, 32}}};

struct BenchFrame {
  FrameFormat format;
  Image<std::uint16_t> pixels;
  Image<float> true_dx_px;  ///< [rows, cols] from the windows' centres
  Image<float> true_dy_px;

  FrameView view() const {
    return {reinterpret_cast<const std::byte*>(pixels.data()), format.rows, format.cols,
            PixelType::kU16};
  }
};

/// Where the spots of a frame are displaced to, always within ±P/8 px.
enum class BenchSlopes {
  kRandom,  ///< every lenslet for itself: for the accuracy of centroids
  kSmooth,  ///< a wavefront of a few long waves: for whole pipelines, few vortices but noise's own
};

BenchFrame make_bench_frame(const BenchCase& which, BenchSlopes slopes, std::uint64_t seed);

/// The sensor of these frames: windows that tile the frame, references at their centres, gain 1,
/// background known, 1 electron an ADU.
Sensor tiled_sensor(const BenchCase& which);

/// Gives the sensor an uneven dark, a flat of a few % and some bad pixels, so that all maps are
/// in use.
void add_maps(Sensor& sensor, std::uint64_t seed);

}  // namespace curlew
