// From a realisation to what a detector gets: noise, centroids, slopes, circulation, split.
#pragma once

#include <cstdint>
#include <limits>
#include <optional>

#include "acquisition/simulator/simulator_options.h"
#include "centroiding/centroid.h"
#include "centroiding/sensor.h"
#include "centroiding/slopes.h"
#include "core/frame.h"
#include "core/hodge_split.h"
#include "core/slope_field.h"
#include "core/vortex.h"
#include "reconstruct/split.h"
#include "service/bench/detection_dataset.h"

namespace curlew {

inline constexpr double kWithoutNoise = std::numeric_limits<double>::infinity();  ///< photons

struct MeasurementOptions {
  double photons = 1000.0;    ///< a lenslet of amplitude 1; infinite: no noise, and no threshold
  double read_noise_e = 1.0;  ///< rms
  CentroidMethod method = CentroidMethod::kThresholded;
  double threshold_noise = 3.0;  ///< read noises, of all but kPlain
  // See CentroidOptions.
  double spot_sigma_px = 0.0;
  double reference_pull = 3.0;
  int brightest_pixels = 0;
  PupilShape pupil = PupilShape::kSquare;  ///< which lenslets get light
  double faded = 0.0;  ///< part of the pupil's lenslets, drawn anew in every frame, that are dark
};

/// All that does not change from frame to frame. Const after construction, shared by threads.
///
/// The sensor is ideal but for its windows: references where a plane wave's spots lie; one gain for
/// all, measured with tilts of ±.25 rad a pitch at the very flux and threshold. Counts are fine
/// enough (.25 electrons or less) and range far enough for neither to matter. Lenslets are neither
/// dropped for faintness nor at their window's edge: vortices sit in the dark. Those outside the
/// pupil the sensor does not have.
class MeasurementPlan {
 public:
  /// Throws UsageError on numbers that make no sense.
  MeasurementPlan(const FieldParameters& parameters, const MeasurementOptions& options);

  const FieldParameters& parameters() const { return parameters_; }
  const MeasurementOptions& options() const { return options_; }
  bool noisy() const { return noisy_; }
  const Sensor& sensor() const { return sensor_; }
  const FrameFormat& format() const { return format_; }
  const CentroidPlan& centroid() const { return *centroid_; }
  const SlopePlan& slopes() const { return *slopes_; }
  const SplitPlan& split() const { return split_; }

  /// The flux, in ADU, of a lenslet of amplitude 1, were all its light in the window and above the
  /// threshold.
  double flux_unit_adu() const;

 private:
  Sensor make_sensor(double gain) const;
  double measure_gain() const;

  FieldParameters parameters_;
  MeasurementOptions options_;
  bool noisy_;
  double e_per_adu_;
  FrameFormat format_;
  Sensor sensor_;
  std::optional<CentroidPlan> centroid_;
  std::optional<SlopePlan> slopes_;
  SplitPlan split_;
};

/// One frame and all that was measured in it; filled anew by every measure_frame.
struct MeasuredFrame {
  explicit MeasuredFrame(const MeasurementPlan& plan);

  FrameBuffer frame;  ///< u16 counts
  /// As find_centroids leaves them. Noise-free frames: their flux is in units of
  /// MeasurementPlan::flux_unit_adu too, though every window was exposed for itself.
  Centroids centroids;
  /// All valid: where the centroid is not (no light above the threshold) the slope is 0, with the
  /// variance of a spot that may be anywhere in its window. Noise-free frames: variances are 0.
  SlopeField slopes;
  CirculationMap circulation;  ///< of these slopes: every cell is valid
  SplitWorkspace split_workspace;
  HodgeSplit split;  ///< of these slopes
};

/// Draws the faded lenslets of the seed and the noise of (seed, photons), and measures. The same
/// arguments give the same bits. One plan and realisation serve many threads, each with a
/// MeasuredFrame of its own. Half a ms a frame of 16×16 lenslets with noise, which is drawing
/// photons; .06 ms without.
void measure_frame(const MeasurementPlan& plan, const Realisation& realisation, std::uint64_t seed,
                   MeasuredFrame& measured);

}  // namespace curlew
