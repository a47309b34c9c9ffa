// This file declares how the classifier learns how blurred the spots of a frame are, and what the
// encoder of spots is then told.
#pragma once

#include <array>
#include <vector>

#include "core/centroids.h"
#include "core/frame.h"
#include "detect/classifier/classifier_network.h"
#include "detect/classifier/sensor_encoder.h"
#include "detect/classifier/spot_features.h"

namespace curlew {

/// The network was taught blurs up to this σ, in λ/w.
inline constexpr double kTaughtBlur = 0.8;

/// What the encoder of spots is told of a sensor whose spots have one blur.
struct SpotCoding {
  DenseLayer layer;     ///< the encoder's first
  float excess_spread;  ///< of second moments, see excess_spread()
};

/// Holds a coding for the blur that the calibration states, and others for frames whose spots are
/// wider. It is const after construction.
class SpotCodings {
 public:
  /// taught: the first layer of an encoder. Where as_trained, features come in the order of
  /// spot_mode(), else in that of SpotFeatures::measure_many().
  SpotCodings(const DenseLayer& taught, const SpotCamera& camera, bool as_trained);

  /// Returns the coding for the blur that the calibration states.
  const SpotCoding& as_calibrated() const { return codings_.front(); }

  /// Returns the σ in λ/w of the blur that gives spots cores of this variance in (λ/w)², at most
  /// 1.2. It is not known (NaN) for NaN and where pixels are coarser than 1.4 a λ/w.
  double blur_of(double core_variance) const noexcept;

  /// Returns the coding for frames of this blur: that of the calibration where the blur is unknown
  /// (NaN) or hardly larger, and null where it is larger than the network was taught.
  const SpotCoding* find(double blur) const noexcept;

 private:
  static constexpr double kStep = 0.05;  // λ/w
  static constexpr int kSteps = 24;

  double told_blur_;
  std::array<double, kSteps + 1> core_variance_{};  // of spots with multiples of kStep
  std::vector<SpotCoding> codings_;                 // as calibrated, then multiples of kStep
};

/// Returns the median variance of the cores of up to 24 bright spots in (λ/w)², and NaN where there
/// are fewer than 8. Turbulence hardly changes it: the brighter half of the spots is as wide behind
/// Rytov variance 4 as without, within .014. `buffer` has room for 24 spots' features and
/// kProjectionSlack more.
double typical_core_variance(const SpotFeatures& features, FrameView frame, const FrameShift& shift,
                             const Centroids& centroids, float mean_flux_adu,
                             float* buffer) noexcept;

}  // namespace curlew
