// The frames on which centroid codes are compared. They show Gaussian spots of σ = P/6 px, but at
// least .9 and at most 2 px, with a peak of 2000·exp(½N(0,1)) ADU, but at most 30000. The spots are
// displaced uniformly within ±P/8 px on both axes. The background is 100 ADU, with Gaussian noise
// of 3 ADU and no photon noise. Pixels are u16.
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
  int window_px = 0;  ///< P: pixels per lenslet side
};
inline constexpr std::array<BenchCase, 3> kBenchCases = {{{40, 40, 6}, {80, 80, 10}, {30, 30, 32}}};

/// Returns σ of the spots.
double bench_spot_sigma_px(const BenchCase& which);

struct BenchFrame {
  FrameFormat format;
  Image<std::uint16_t> pixels;
  Image<float> true_dx_px;  ///< [rows, cols], from the windows' centres
  Image<float> true_dy_px;

  FrameView view() const {
    return {reinterpret_cast<const std::byte*>(pixels.data()), format.rows, format.cols,
            PixelType::kU16};
  }
};

/// How the spots of a frame are displaced, always within ±P/8 px.
enum class BenchSlopes {
  kRandom,  ///< every lenslet on its own, for the accuracy of centroids
  /// By a wavefront of a few long waves, for whole pipelines: hardly any vortices but those of
  /// noise.
  kSmooth,
};

/// Draws one frame. The same arguments give the same frame.
BenchFrame make_bench_frame(const BenchCase& which, BenchSlopes slopes, std::uint64_t seed);

/// Returns the format of a case's frames. Frames of kU8 are what a camera of 8 bits would make of
/// the same light, at 16 ADU a count.
FrameFormat bench_format(const BenchCase& which, PixelType pixel_type);

/// Returns the frame's pixels as a source of that format delivers them: brighter pixels are cut
/// off.
AlignedVector<std::byte> bench_pixels(const BenchFrame& frame, const FrameFormat& format);

/// Returns the sensor of these frames: its windows tile the frame, the references are the windows'
/// centres, the gain is 1, the background is known, and 1 ADU is 1 electron.
Sensor tiled_sensor(const BenchCase& which);

/// Gives the sensor an uneven dark, a flat of a few % and some bad pixels, so that all maps are in
/// use.
void add_maps(Sensor& sensor, std::uint64_t seed);

}  // namespace curlew
