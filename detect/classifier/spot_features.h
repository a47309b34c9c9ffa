// What a spot's picture tells a classifier: its modes, its brightness, its noise.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "core/frame.h"
#include "core/image.h"
#include "detect/classifier/spot_projection.h"

namespace curlew {

/// A lenslet's window on the detector and where a plane wave's spot lies, in pixels of the frame.
struct SpotWindow {
  int x0 = 0;
  int y0 = 0;
  int w = 0;  ///< 0: there is no lenslet
  int h = 0;
  float reference_x = 0;
  float reference_y = 0;
};

/// Where the spots are and what a count means.
struct SpotCamera {
  Image<SpotWindow> windows;       ///< [rows, cols] of lenslets
  double pixels_per_lambda_w = 0;  ///< λ/w, as an angle, on the detector
  bool rows_run_up = false;        ///< lenslet rows run up the detector: a mirrored relay
  double background_adu = 0.0;     ///< where there is no dark
  double e_per_adu = 0.0;          ///< not above 0, or NaN: unknown, and the noise with it
  double read_noise_e = 0.0;
  Image<float> dark_adu;  ///< [frame rows, frame cols] or empty
  Image<float> response;  ///< likewise: relative response of a pixel, 0 where it is bad
};

/// Σ over a spot's pixels of signal·h_m(x)·h_n(y), h the Hermite functions of .6 λ/w width about
/// the reference, for m + n ≤ kHighestOrder; by m + n, then m.
inline constexpr int kHighestOrder = kProjectionOrders - 1;
inline constexpr int kSpotModes = (kHighestOrder + 1) * (kHighestOrder + 2) / 2;
/// The modes over the flux, then: logarithm of the flux over the frame's mean, photon noise and
/// read noise over the flux, and 1.
inline constexpr int kSpotFeatures = kSpotModes + 4;

/// A mode's orders.
struct SpotMode {
  int m;
  int n;
};
SpotMode spot_mode(int index);
int spot_mode_index(SpotMode mode);

/// measure_many writes the modes by n, then m: feature i of spot_mode's order is its
/// kMeasuredPlaces[i].
extern const std::array<int, kSpotFeatures> kMeasuredPlaces;

/// Const after construction, shared by threads. Pixels farther than 1.75 λ/w from the reference
/// along an axis are left out, so that windows of any size come to the same.
class SpotFeatures {
 public:
  /// Throws Failure where windows do not lie in the frame or the scale makes no sense.
  SpotFeatures(const SpotCamera& camera, const FrameFormat& format);

  int rows() const { return spots_.rows(); }
  int cols() const { return spots_.cols(); }
  std::size_t lenslet_count() const { return spots_.size(); }  ///< missing ones too
  bool has_lenslet(std::size_t k) const { return spots_[k].w > 0; }

  /// Fills `features` [kSpotFeatures] of lenslet k. flux and mean_flux: as centroids have them, of
  /// this lenslet and on average, in ADU.
  void measure(FrameView frame, std::size_t k, float flux_adu, float mean_flux_adu,
               float* features) const noexcept;

  /// The same of n ≤ kMaxAtOnce lenslets, faster, the logarithm to 1e-6: features [n,
  /// kSpotFeatures] and kProjectionSlack more, in the order of kMeasuredPlaces. flux_adu: of all.
  void measure_many(FrameView frame, const std::int32_t* lenslets, int n, const float* flux_adu,
                    float mean_flux_adu, float* features) const noexcept;
  static constexpr int kMaxAtOnce = 64;

 private:
  ProjectedFrame projected(FrameView frame) const noexcept;
  /// Features after the modes; the logarithm's argument is in the place of it.
  void add_noise(const ProjectedWindow& spot, float flux, float flux_adu, float mean_flux_adu,
                 float* features) const noexcept;

  Image<ProjectedWindow> spots_;
  AlignedVector<float> table_;  // [steps, kProjectionLanes]
  PixelType pixel_type_;
  float e_per_count_;
  float e_per_adu_;
  float background_counts_;
  bool noise_known_;
  float row_sign_;  // of odd orders along y
  Image<float> dark_counts_;
  Image<float> gain_;
};

}  // namespace curlew
