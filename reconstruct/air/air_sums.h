// AirSums are what frames have to say of the air, summed up.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "core/centroids.h"
#include "core/slope_field.h"
#include "core/vortex.h"
#include "reconstruct/air/air_plan.h"

namespace curlew {

/// The moves that are looked for from one frame to a later one: by up to kFarthest lenslets each
/// way, after kLags[i] frames.
inline constexpr int kFarthestMove = 4;
inline constexpr int kMoves = 2 * kFarthestMove + 1;
inline constexpr std::array<std::int64_t, 6> kLags = {1, 2, 4, 8, 16, 32};

/// Sums over frames, which can be added and subtracted.
struct AirSums {
  explicit AirSums(const AirPlan& plan);
  AirSums& operator+=(const AirSums& more);
  AirSums& operator-=(const AirSums& less);

  std::int64_t frames = 0;
  double seconds = 0.0;    ///< between frames and those before them,
  std::int64_t steps = 0;  ///< and by how many numbers these are apart
  // Pairs of slopes: halves of their squared differences, and those that noise explains.
  double pair_square = 0.0;
  double pair_noise = 0.0;
  std::int64_t pairs = 0;
  Eigen::ArrayXd mode_square;  ///< of the plan's modes, rad²
  Eigen::ArrayXd mode_noise;
  std::int64_t mode_frames = 0;
  // By lenslet.
  Eigen::ArrayXd light, light_square, light_noise, light_count;  ///< adu, adu², adu²
  Eigen::ArrayXd slope_x, slope_y, slope_count;                  ///< less the mean of the frame
  double slope_square = 0.0;  ///< of those slopes, less what noise explains
  /// Products of slopes with those that are moved, for each of kLags: [kMoves, kMoves].
  std::array<Eigen::ArrayXXd, kLags.size()> products;
  std::array<Eigen::ArrayXXd, kLags.size()> product_count;
  std::int64_t vortices = 0;
  double lenslets = 0.0;                    ///< lit ones, over all frames
  double vortex_vx = 0.0, vortex_vy = 0.0;  ///< of vortices on tracks, pitches a second
  std::int64_t tracked = 0;
};

/// One frame, as it is summed up. All maps are [rows, cols].
struct AirSample {
  AirSample(int rows, int cols, std::size_t vortex_capacity)
      : slopes(rows, cols),
        light_adu(rows, cols),
        area_px(rows, cols),
        state(rows, cols, LensletState::kUnlit),
        vortices(vortex_capacity) {}

  double time_s = 0.0;
  std::int64_t sequence = 0;
  SlopeField slopes;
  Image<float> light_adu;  ///< of the whole window, above the level
  Image<float> area_px;    ///< pixels of the window; 0: its light is not known
  Image<LensletState> state;
  VortexList vortices;
};

/// Noise of the light in a window: variance in adu² = light·per_light + area·per_pixel.
struct LightNoise {
  double per_light = 0.0;
  double per_pixel = 0.0;
};

/// Sums up frame after frame. It is no part of the frame path.
class AirCollector {
 public:
  AirCollector(const AirPlan& plan, const LightNoise& noise);

  /// Adds a frame to the sums; frames come in their order.
  void add(const AirSample& sample, AirSums& sums);

 private:
  /// Slopes less their mean over the frame; 0 where there is none.
  struct Kept {
    std::int64_t sequence = -1;
    Image<float> x, y, valid;
  };

  void keep(const AirSample& sample, AirSums& sums);
  void add_pairs(const SlopeField& slopes, AirSums& sums) const;
  void add_modes(const SlopeField& slopes, AirSums& sums);
  void add_light(const AirSample& sample, AirSums& sums) const;
  void add_products(std::size_t lag, AirSums& sums) const;
  const Kept* kept(std::int64_t sequence) const;

  const AirPlan& plan_;
  LightNoise noise_;
  ModeFit fit_;
  std::vector<Kept> kept_;  ///< a ring, by sequence
  std::int64_t newest_ = -1;
  double newest_s_ = 0.0;
  std::size_t next_lag_ = 0;
};

}  // namespace curlew
