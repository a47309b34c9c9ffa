// What a spot's picture tells a classifier: its modes, its brightness, its noise.
#pragma once

#include <array>
#include <cstddef>

#include "core/frame.h"
#include "core/image.h"
#include "detect/spot_projection.h"

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

/// What project_window makes of a window.
struct SpotProjection {
  std::array<float, std::size_t{kProjectionOrders} * kProjectionLanes> sums;
  float total;
};

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

  /// The work in two, so that many lenslets can be projected in a row before any is described.
  void project(FrameView frame, std::size_t k, SpotProjection& projection) const noexcept;
  void describe(std::size_t k, SpotProjection& projection, float flux_adu, float mean_flux_adu,
                float* features) const noexcept;

  /// Fills `features` [kSpotFeatures] of lenslet k. flux and mean_flux: as centroids have them, of
  /// this lenslet and on average, in ADU.
  void measure(FrameView frame, std::size_t k, float flux_adu, float mean_flux_adu,
               float* features) const noexcept;

 private:
  static constexpr int kStepsPerPx = 16;  // references are rounded to this part of a pixel
  struct Spot {
    int x0 = 0;
    int y0 = 0;
    int w = 0;
    int h = 0;
    int table_x = 0;  // of the first pixel, in steps
    int table_y = 0;
    float read_noise = 0;  // of the whole window, electrons
  };

  Image<Spot> spots_;
  AlignedVector<float> table_;  // [steps, kProjectionLanes]
  PixelType pixel_type_;
  std::ptrdiff_t frame_cols_;
  float e_per_count_;
  float e_per_adu_;
  float background_counts_;
  bool noise_known_;
  float row_sign_;  // of odd orders along y
  Image<float> dark_counts_;
  Image<float> gain_;
};

}  // namespace curlew
