// Windows that follow the spots, and lenslets whose spot is lost.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "centroiding/centroid.h"
#include "centroiding/foreign_light.h"
#include "centroiding/frame_level.h"
#include "centroiding/low_orders.h"
#include "centroiding/pixel_counter.h"
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
  LevelForecast level;      ///< what the frame before says of the next one
};

/// Follows the spots of one sensor from frame to frame. Its state belongs to the frames of one
/// plan, in their order; one thread calls it.
///
/// Windows stay where they are while the low orders of the spots' displacements (a quadratic fit)
/// lie within .15 pitch of them, or within .05 where spots are so wide that they light the corners
/// in which the level is measured. When these leave that, the windows are moved to them by whole
/// pixels and the same frame is measured again. Where the fit does not describe the spots, or the
/// pattern of lit lenslets has stepped by a pitch, SpotAcquisition finds them anew. Where many
/// spots are too faint to be valid, all of them are fitted together; such a frame tells nothing of
/// which lenslets are lit.
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
///
/// A frame that is still arriving is measured by the noise of the frame before and where the
/// windows are. So that whole frames give the same bits, they too go by the noise of the frame
/// before where their own is about the same (came_true()).
class WindowFollower {
 public:
  WindowFollower(const Sensor& sensor, const CentroidPlan& plan, const LevelPlan& level_plan,
                 const CentroidOptions& options);

  /// Measures one frame, of the plans' format: its levels, its sharp pixels and, with the windows
  /// where they belong, its spots. `centroids` also says how far the windows were moved. The plans
  /// must be those of the constructor. What measure_ahead() has measured of the frame is not
  /// measured again where it holds, and the results are the same bits. Never allocates.
  FollowState measure(const CentroidPlan& plan, const LevelPlan& level_plan,
                      const SharpPixelPlan& sharp_plan, FrameView frame, FrameLevels& levels,
                      SharpPixels& sharp, Centroids& centroids, Team* team = nullptr) noexcept;

  /// Measures as much as possible of a frame of which the first `ready` rows have arrived, and
  /// returns how many rows of lenslets are measured. Never allocates.
  int measure_ahead(const CentroidPlan& plan, const LevelPlan& level_plan,
                    const SharpPixelPlan& sharp_plan, FrameView frame, int ready,
                    FrameLevels& levels, SharpPixels& sharp, Centroids& centroids) noexcept;

  /// Forgets what was measured ahead of a frame that never became whole.
  void give_up() noexcept;

  /// [rows] 1 where measure() left a row of lenslets other than measure_ahead() did.
  const std::vector<std::uint8_t>& row_changed() const { return row_changed_; }

  /// After as many frames the windows no longer depend on how they came there.
  static constexpr std::int64_t kSettlingFrames = 64;

  FollowerMemory memory() const;
  /// Goes on as the follower did whose memory this is. The plans must be those of the constructor,
  /// and so must the size.
  void recall(const CentroidPlan& plan, const LevelPlan& level_plan, const FollowerMemory& memory);

 private:
  /// How far a frame that is still arriving has been measured.
  struct Ahead {
    bool begun = false;
    int rows = 0;     ///< of lenslets, where the windows are
    int centred = 0;  ///< rows of them in which spots were measured in centred windows as well
  };

  void place_windows(const CentroidPlan& plan, const LevelPlan& level_plan,
                     const LowOrders& model) noexcept;
  void place_window(const CentroidPlan& plan, std::size_t k, int dx, int dy,
                    Image<CentroidPlan::Spot>& windows) const noexcept;
  bool is_off_centre(const Centroids& looked, std::size_t k) const noexcept;
  void centre_window(const CentroidPlan& plan, const Centroids& looked, std::size_t k,
                     Centroids& centroids) noexcept;
  void return_window(std::size_t k, Centroids& centroids) noexcept;
  void return_windows() noexcept;
  void centre_ahead(const CentroidPlan& plan, FrameView frame, int ready, const FrameLevels& levels,
                    const SharpPixels& sharp, Centroids& centroids) noexcept;
  void centre_spots(const CentroidPlan& plan, const SharpPixelPlan& sharp_plan, FrameView frame,
                    const FrameLevels& levels, SharpPixels& sharp, const Centroids& looked,
                    Centroids& centroids) noexcept;
  bool has_bad_window(const CentroidPlan::Spot& spot) const noexcept;
  void measure_lower_level(const LevelPlan& level_plan, FrameView frame,
                           FrameLevels& levels) noexcept;
  void count_rows_needed(const LevelPlan& level_plan) noexcept;
  void tell_windows(Centroids& centroids) const noexcept;
  bool go_by_forecast(const LevelPlan& level_plan, FrameLevels& levels) noexcept;
  const Centroids& measure_spots(const CentroidPlan& plan, const LevelPlan& level_plan,
                                 const SharpPixelPlan& sharp_plan, FrameView frame,
                                 FrameLevels& levels, SharpPixels& sharp,
                                 Centroids& centroids) noexcept;
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
  ForeignLight foreign_light_;
  float pitch_px_;
  float followed_px_;  ///< Windows stay while the spots' low orders are within this.
  std::vector<LevelPixel> middle_blocks_;  ///< for the level in the middles of the windows
  float max_bad_fraction_;
  bool measures_ahead_;          ///< CentroidOptions::measure_ahead
  Image<std::uint8_t> lenslet_;  ///< [rows, cols] 1 where the plan has one
  float reach_px_;               ///< spot_reach_px()
  Image<float> off_x_px_;        ///< off_middle_px() of the references; 0 without bends
  Image<float> off_y_px_;
  Image<float> middle_x_px_;  ///< the reference less this; where a spot is measured in the middle
  Image<float> middle_y_px_;
  PixelCounter bad_pixels_;      ///< empty where there are no maps
  std::vector<float> column_u_;  ///< [cols] the model's coordinate of a column

  // The state.
  LowOrders model_;                    ///< where the windows are
  Image<CentroidPlan::Spot> windows_;  ///< the plan's, moved there
  Image<CentroidPlan::Spot> centred_;  ///< the same, but centred on the spot where off_centre_ says
  WindowStrips strips_;                ///< of windows_
  std::vector<LevelPixel> blocks_;     ///< where the level is measured
  LevelForecast forecast_;             ///< for the frame at hand
  Image<float> moved_x_px_;            ///< by whole pixels
  Image<float> moved_y_px_;
  std::int64_t frames_ = 0;

  // These follow from the state, where frames are measured ahead.
  std::vector<int> block_rows_needed_;  ///< [rows + 1] rows of the frame that blocks_ lie in
  std::vector<int> rows_needed_;        ///< [rows] rows of the frame that windows_ lie in

  // Buffers of one frame.
  Team* team_ = nullptr;  ///< shares the work on the frame at hand, where there is one
  Ahead ahead_;
  LevelForecast next_forecast_;
  std::vector<std::uint8_t> row_changed_;
  Image<float> level_;
  Image<float> model_x_px_;  ///< of each lenslet
  Image<float> model_y_px_;
  Image<std::uint8_t> off_centre_;  ///< not 0 where a window of centred_ is centred
  bool any_centred_ = false;        ///< whether there are any
  Image<std::uint8_t> due_;         ///< those of them that are to be measured
  Centroids first_look_;            ///< as measured in windows_, where this was done ahead
};

}  // namespace curlew
