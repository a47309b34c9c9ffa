// The level between the spots of one frame, and its noise. Both are properties of the frame and not
// of the calibration: the sky, stray light and the detector's offset change.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "centroiding/centroid.h"
#include "centroiding/low_orders.h"
#include "centroiding/sensor.h"
#include "core/frame.h"
#include "core/image.h"

namespace curlew {

/// A pixel in which the level is measured. Its value above the calibration's dark is gain·count −
/// offset, in counts.
struct LevelPixel {
  std::int32_t index = 0;  ///< in the frame
  float gain = 0;
  float offset = 0;
};

/// Says where the level is measured: in a block at every corner between lenslets, where a spot
/// gives the least light. Const after construction, shared by threads.
class LevelPlan {
 public:
  /// Takes a sensor and options that `centroid` was made of. A block's side is a fifth of a pitch,
  /// and at most nine of its pixels are looked at.
  LevelPlan(const Sensor& sensor, const CentroidPlan& centroid, const CentroidOptions& options);

  /// Sets the pixels of all blocks where the spots are moved by the model's displacements. Bad
  /// pixels are replaced by good ones near by, and corners beyond the frame by its rim. `pixels`
  /// must be of the size of pixels().
  void place(const CentroidPlan& centroid, const LowOrders& model, std::vector<LevelPixel>& pixels,
             Team* team = nullptr) const noexcept;

  int frame_rows() const { return frame_rows_; }
  int frame_cols() const { return frame_cols_; }
  int rows() const { return rows_; }  ///< lenslets
  int cols() const { return cols_; }

  /// [rows + 1, cols + 1] corners, each with block_pixels() pixels, where no spot is moved.
  const std::vector<LevelPixel>& pixels() const { return pixels_; }
  int block_pixels() const { return block_pixels_; }
  /// Spots as wide as a fifth of the pitch light the corners, unevenly.
  bool corners_are_lit() const { return corners_are_lit_; }

  /// T for frames of this noise, in counts; see CentroidOptions. It is never lower than the read
  /// noise of the sensor file asks for, so that a reference that is less noisy than the frames can
  /// be measured at their T.
  float threshold(float noise) const {
    return plain_
               ? 0.0F
               : std::max(fixed_threshold_, threshold_noise_ * std::max(known(noise), read_noise_));
  }
  /// The variance of a pixel's noise in counts²; 0 where the detector's gain is not known.
  float pixel_variance(float noise) const {
    return gain_known_ ? std::max(known(noise) * known(noise), 1.0F / 12.0F) : 0.0F;
  }

 private:
  /// Light in the corners is no noise. There the noise is that of the sensor file.
  float known(float noise) const { return corners_are_lit_ ? read_noise_ : noise; }

  int frame_rows_;
  int frame_cols_;
  int rows_;
  int cols_;
  LensletGrid grid_;
  int block_side_px_;
  int block_pixels_ = 0;
  std::vector<LevelPixel> pixels_;
  bool corners_are_lit_;
  bool plain_;
  bool gain_known_;
  float fixed_threshold_;  ///< counts
  float read_noise_;       ///< of the sensor file, counts; 0 where it is not known
  float threshold_noise_;
};

/// The level of one frame, and what follows from it. Made once and filled anew for each frame.
struct FrameLevels {
  explicit FrameLevels(const LevelPlan& plan);

  Image<float> level;        ///< [rows, cols] counts above the calibration's dark
  float noise = 0;           ///< rms of a pixel between the spots, counts
  float threshold = 0;       ///< T above the level, counts
  float pixel_variance = 0;  ///< counts²

  // Buffers of measure_levels().
  Image<float> corner;  ///< [rows + 1, cols + 1]
  Image<float> scratch;
  std::vector<float> values;  ///< of all blocks' pixels
  std::vector<float> residuals;
  Image<float> raw;  ///< [rows, cols] before it is smoothed

  float highest = 0;  ///< of `level`, counts
  float lowest = 0;
  // Counts that no level exceeds, and that none is below; sharp and dead pixels are sought by them.
  float bound = 0;
  float floor = 0;
  // How many rows have been measured of a frame that is still arriving.
  int corner_rows = 0;
  int raw_rows = 0;
  int rows = 0;  ///< of `level`
  std::size_t n_residuals = 0;
  std::size_t next_residual = 0;  ///< the pixel of the next one, counted from the next block
};

/// Measures the level and the noise of one frame, of the plan's format, in the pixels that
/// LevelPlan::place() gave. Never allocates.
///
/// A block's value is its median, a lenslet's that of its four blocks, and these are smoothed by a
/// median over five lenslets down and then across, of fewer near the rim so that a gradient stays
/// what it is. Spots, hot pixels and cosmic rays that reach less than half of the blocks do not
/// count. The noise is the rms of the blocks' pixels about the level, beyond 3 σ cut off.
void measure_levels(const LevelPlan& plan, const std::vector<LevelPixel>& pixels, FrameView frame,
                    FrameLevels& levels, Team* team = nullptr) noexcept;

/// Measures as many rows of the level as the first `corner_rows` rows of blocks allow, for frames
/// that are still arriving. FrameLevels::rows says how many these are, and begins at 0.
void measure_level_rows(const LevelPlan& plan, const std::vector<LevelPixel>& pixels,
                        FrameView frame, int corner_rows, FrameLevels& levels,
                        Team* team = nullptr) noexcept;

/// Finds the noise and what follows from it, once all rows are measured.
void finish_levels(const LevelPlan& plan, FrameLevels& levels) noexcept;

/// Begins a frame that is still arriving.
void begin_levels(FrameLevels& levels) noexcept;

/// What a frame's noise and level are taken for before it is whole.
struct LevelForecast {
  float noise = -1.0F;  ///< counts; negative where nothing is known
  float bound = 0.0F;   ///< counts that no level exceeds
  float floor = 0.0F;   ///< counts that no level is below
};

/// Returns the forecast for the frame that follows the one of these levels.
LevelForecast forecast_after(const FrameLevels& levels) noexcept;

/// Returns whether the forecast came true: the frame's noise differs by less than an eighth, which
/// is 3.5 standard deviations of the difference between two frames, and its levels come near the
/// bounds and lie between them.
bool came_true(const LevelForecast& forecast, const FrameLevels& levels) noexcept;

/// Sets levels.threshold, pixel_variance, bound and floor to what follows from the forecast.
void go_by(const LevelPlan& plan, const LevelForecast& forecast, FrameLevels& levels) noexcept;

}  // namespace curlew
