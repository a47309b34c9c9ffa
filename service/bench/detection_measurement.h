// Takes a realisation to what a detector gets: noise, centroids, slopes, circulation, split.
#pragma once

#include <cstdint>
#include <limits>
#include <optional>

#include "acquisition/simulator/simulator_options.h"
#include "centroiding/centroid.h"
#include "centroiding/frame_level.h"
#include "centroiding/sensor.h"
#include "centroiding/slopes.h"
#include "core/frame.h"
#include "core/hodge_split.h"
#include "core/slope_field.h"
#include "core/vortex.h"
#include "detect/classifier/spot_features.h"
#include "reconstruct/split.h"
#include "service/bench/detection_dataset.h"

namespace curlew {

inline constexpr double kWithoutNoise = std::numeric_limits<double>::infinity();  ///< photons

struct MeasurementOptions {
  /// Photons of a lenslet of amplitude 1; infinite: no noise and no threshold.
  double photons = 1000.0;
  double read_noise_e = 1.0;  ///< electrons, rms
  CentroidMethod method = CentroidMethod::kThresholded;
  double threshold_noise = 3.0;  ///< in read noises; it holds for all methods but kPlain
  // These three are explained in CentroidOptions.
  double spot_sigma_px = 0.0;
  double reference_pull = 3.0;
  int brightest_pixels = 0;
  PupilShape pupil = PupilShape::kSquare;  ///< which lenslets get light
  double blur = 0.0;                       ///< σ of a Gaussian that blurs the spots, λ/w
  /// Electrons a pixel that the sensor's dark does not have; the level is then measured in every
  /// frame. Needs noise.
  double sky_e = 0.0;
  double faded = 0.0;  ///< part of the pupil's lenslets that are dark, drawn anew in every frame
};

/// All that does not change from frame to frame. It is const after construction and shared by
/// threads.
///
/// The sensor is ideal except for its windows. The references are where a plane wave's spots lie.
/// All lenslets have one gain, measured with tilts of ±.25 rad a pitch at the same flux and
/// threshold. Counts are so fine (.25 electrons at the benchmark's fluxes) and reach so far that
/// neither matters. No lenslet is dropped because it is faint or at its window's edge, for vortices
/// sit in the dark. The sensor has no lenslets outside the pupil.
class MeasurementPlan {
 public:
  /// Throws UsageError if numbers make no sense.
  MeasurementPlan(const FieldParameters& parameters, const MeasurementOptions& options);

  const FieldParameters& parameters() const { return parameters_; }
  const MeasurementOptions& options() const { return options_; }
  bool noisy() const { return noisy_; }
  const Sensor& sensor() const { return sensor_; }
  const FrameFormat& format() const { return format_; }
  const CentroidPlan& centroid() const { return *centroid_; }
  const std::optional<LevelPlan>& level() const { return level_; }  ///< where there is a sky
  const SlopePlan& slopes() const { return *slopes_; }
  const SplitPlan& split() const { return split_; }

  /// Returns the flux, in ADU, that a lenslet of amplitude 1 would have if all its light were in
  /// the window and above the threshold.
  double flux_unit_adu() const;

  Image<float> blur(const Image<float>& light) const;  ///< light after the options' blur

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
  std::optional<LevelPlan> level_;
  std::optional<SlopePlan> slopes_;
  SplitPlan split_;
};

/// One frame and all that was measured in it. Every measure_frame fills it anew.
struct MeasuredFrame {
  explicit MeasuredFrame(const MeasurementPlan& plan);

  /// Returns what the classifier must know of the frame; it points into this object.
  FrameShift shift() const;

  FrameBuffer frame;                  ///< counts, u16
  std::optional<FrameLevels> levels;  ///< where there is a sky
  /// The centroids as find_centroids leaves them. In noise-free frames, too, the flux is in units
  /// of MeasurementPlan::flux_unit_adu, although every window had a scale of its own.
  Centroids centroids;
  /// The slopes, all valid. Where the centroid is not valid (no light above the threshold) the
  /// slope is 0, with the variance of a spot that may be anywhere in its window. In noise-free
  /// frames variances are 0.
  SlopeField slopes;
  CirculationMap circulation;  ///< made of these slopes; every cell is valid
  SplitWorkspace split_workspace;
  HodgeSplit split;  ///< made of these slopes
};

/// Draws the faded lenslets from the seed and the noise from (seed, photons), and measures the
/// frame. The same arguments give the same bits. Many threads may use one plan and realisation,
/// each with a MeasuredFrame of its own. A frame of 16×16 lenslets takes half a ms with noise,
/// which is mostly drawing photons, and .06 ms without.
void measure_frame(const MeasurementPlan& plan, const Realisation& realisation, std::uint64_t seed,
                   MeasuredFrame& measured);

}  // namespace curlew
