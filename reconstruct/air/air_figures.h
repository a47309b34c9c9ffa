// AirFigures say what the air was like while frames were summed up.
#pragma once

#include <cstdint>
#include <limits>
#include <vector>

#include "reconstruct/air/air_sums.h"

namespace curlew {

/// A number and its standard error; both are NaN where it is not known.
struct AirFigure {
  double value = std::numeric_limits<double>::quiet_NaN();
  double error = std::numeric_limits<double>::quiet_NaN();
};

/// Errors are those of chance, by leaving out one block of frames after the other (jackknife).
/// Where no clock is known a second is a frame.
struct AirFigures {
  std::int64_t frames = 0;
  double seconds = 0.0;
  AirFigure r0_slopes;      ///< Fried's parameter by differences of slopes, pitches
  AirFigure r0_zernike;     ///< and by modes of radial orders 2 and 3
  AirFigure scintillation;  ///< variance of a lenslet's light over its squared mean
  AirFigure wind_x;         ///< drift of the slopes' pattern, pitches a second
  AirFigure wind_y;
  AirFigure tau0;           ///< .314 r0/|wind|, s
  AirFigure vortex_wind_x;  ///< mean velocity of vortices on tracks, pitches a second
  AirFigure vortex_wind_y;
  AirFigure vortex_density;  ///< vortices a frame and lit lenslet
};

/// Returns the figures of all blocks together. blocks: sums over frames that follow each other.
AirFigures air_figures(const AirPlan& plan, const std::vector<AirSums>& blocks);

/// Sums up frames in up to kMostBlocks blocks of equal length, however many frames there are.
class AirWindow {
 public:
  AirWindow(const AirPlan& plan, const LightNoise& noise) : plan_(plan), collector_(plan, noise) {}

  void add(const AirSample& sample);
  AirFigures figures() const { return air_figures(plan_, blocks_); }
  /// Forgets the sums, and not the last frames, from which moves are reckoned.
  void begin_anew();

  static constexpr std::size_t kMostBlocks = 16;

 private:
  const AirPlan& plan_;
  AirCollector collector_;
  std::vector<AirSums> blocks_;
  std::int64_t block_frames_ = 1;
};

}  // namespace curlew
