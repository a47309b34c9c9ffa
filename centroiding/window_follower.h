// Windows that follow the spots, and lenslets whose spot is lost.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "centroiding/centroid.h"
#include "centroiding/frame_level.h"
#include "centroiding/low_orders.h"
#include "centroiding/sensor.h"
#include "centroiding/sharp_pixels.h"
#include "centroiding/spot_acquisition.h"
#include "centroiding/spot_judge.h"
#include "core/centroids.h"
#include "core/frame.h"
#include "core/image.h"

namespace curlew {

/// What became of one frame.
enum class FollowState : std::uint8_t {
  kSettled,   ///< the spots were where the windows are
  kMoved,     ///< the windows were moved after the spots
  kAcquired,  ///< the spots were found anew
  kLost,      ///< the spots were not found; every lenslet with light is kLost
  kNoLight,   ///< there is hardly any light
};

inline constexpr std::size_t kFollowStates = 5;  ///< the number of values of FollowState

/// What the frames before have taught a WindowFollower: all of them that its next frames depend on.
struct FollowerMemory {
  std::int64_t frames = 0;  ///< how many frames came before
  bool started = false;     ///< whether spots were found in one of them
  LowOrders model;          ///< where the windows are, px from where the calibration put them
  Image<std::int8_t> seen;  ///< [rows, cols] how often a lenslet had its spot, of the last ones
};

/// Follows the spots of one sensor from frame to frame. Its state belongs to the frames of one
/// plan, in their order; one thread calls it.
///
/// Windows stay where they are while the low orders of the spots' displacements (a quadratic fit)
/// lie within .15 pitch of them, or within .05 where spots are so wide that they light the corners
/// in which the level is measured. When these leave that, the windows are moved to them by whole
/// pixels and the same frame is measured again. Where the fit does not describe the spots, or the
/// pattern of lit lenslets has stepped by a pitch, SpotAcquisition finds them anew.
///
/// Every kSettlingFrames the windows are put where the frame's spots have them and not the way that
/// led there: where the calibration had them if the low orders are within .1 pitch of that, and
/// else by low orders that are rounded. So what frames long past have taught is forgotten, and a
/// follower that begins later comes to the very same windows (docs/adr/0010-seams.md).
///
/// Then each lenslet is judged. Its spot is lost where it lies farther from the fit than six times
/// what the others do (at least .3 and at most .42 pitch). A spot that is dim or as wide as its
/// window is lost where less than three quarters of its neighbours have a spot, and a faint one or
/// one at its window's edge where less than half have: among others in the dark it is a vortex, and
/// alone it is stray light.
class WindowFollower {
 public:
  WindowFollower(const Sensor& sensor, const CentroidPlan& plan, const LevelPlan& level_plan,
                 const CentroidOptions& options);

  /// Measures one frame, of the plans' format: its levels, its sharp pixels and, with the windows
  /// where they belong, its spots. `centroids` also says how far the windows were moved. The plans
  /// must be those of the constructor. Never allocates.
  FollowState measure(const CentroidPlan& plan, const LevelPlan& level_plan,
                      const SharpPixelPlan& sharp_plan, FrameView frame, FrameLevels& levels,
                      SharpPixels& sharp, Centroids& centroids) noexcept;

  /// After as many frames the windows no longer depend on how they came there.
  static constexpr std::int64_t kSettlingFrames = 64;

  FollowerMemory memory() const;
  /// Goes on as the follower did whose memory this is. The plans must be those of the constructor,
  /// and so must the size.
  void recall(const CentroidPlan& plan, const LevelPlan& level_plan, const FollowerMemory& memory);

 private:
  void place_windows(const CentroidPlan& plan, const LevelPlan& level_plan,
                     const LowOrders& model) noexcept;
  void place_window(const CentroidPlan& plan, std::size_t k, int dx, int dy) noexcept;
  bool centre_windows(const CentroidPlan& plan, const Centroids& centroids) noexcept;
  void return_windows(const CentroidPlan& plan) noexcept;
  bool has_bad_window(const CentroidPlan::Spot& spot) const noexcept;
  void measure_lower_level(const LevelPlan& level_plan, FrameView frame,
                           FrameLevels& levels) noexcept;
  AcquisitionResult acquire(const CentroidPlan& plan, const LevelPlan& level_plan, FrameView frame,
                            FrameLevels& levels, const SharpPixels& sharp,
                            LowOrders& model) noexcept;
  bool is_settled(const SpotFit& found) const noexcept;
  LowOrders settled_model(const LowOrders& spots) const noexcept;
  FollowState measure_frame(const CentroidPlan& plan, const LevelPlan& level_plan,
                            const SharpPixelPlan& sharp_plan, FrameView frame, FrameLevels& levels,
                            SharpPixels& sharp, Centroids& centroids, SpotFit& found) noexcept;

  SpotAcquisition acquisition_;
  SpotJudge judge_;  ///< with its state
  float pitch_px_;
  float followed_px_;  ///< Windows stay while the spots' low orders are within this.
  std::vector<LevelPixel> middle_blocks_;  ///< for the level in the middles of the windows
  float max_bad_fraction_;
  Image<std::uint8_t> lenslet_;  ///< [rows, cols] 1 where the plan has one
  Image<float> ref_x_px_;
  Image<float> ref_y_px_;
  Image<std::int32_t> bad_pixels_;  ///< [rows + 1, cols + 1] of the frame, summed; or empty
  std::vector<float> column_u_;     ///< [cols] the model's coordinate of a column

  // The state.
  LowOrders model_;                    ///< where the windows are
  Image<CentroidPlan::Spot> windows_;  ///< the plan's, moved there
  WindowStrips strips_;                ///< of windows_, but for those that off_centre_ has moved
  std::vector<LevelPixel> blocks_;     ///< where the level is measured
  Image<float> moved_x_px_;            ///< by whole pixels
  Image<float> moved_y_px_;
  std::int64_t frames_ = 0;

  // Buffers of one frame.
  Image<float> level_;
  Image<float> model_x_px_;  ///< of each lenslet
  Image<float> model_y_px_;
  Image<std::uint8_t> off_centre_;  ///< windows that are centred on their spot in this frame
};

}  // namespace curlew
