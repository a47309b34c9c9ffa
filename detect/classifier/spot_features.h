// This file declares what a spot's picture tells the classifier: modes, brightness and noise.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "core/frame.h"
#include "core/image.h"
#include "detect/classifier/spot_projection.h"

namespace curlew {

/// Holds a lenslet's window on the detector and the place of a plane wave's spot, in pixels of the
/// frame.
struct SpotWindow {
  int x0 = 0;
  int y0 = 0;
  int w = 0;  ///< 0 where there is no lenslet
  int h = 0;
  float reference_x = 0;
  float reference_y = 0;
};

/// Says where the spots are and what a count means.
struct SpotCamera {
  Image<SpotWindow> windows;       ///< [rows, cols] of lenslets
  double pixels_per_lambda_w = 0;  ///< λ/w on the detector, taken as an angle
  bool rows_run_up = false;        ///< true for a mirrored relay: lenslet rows run up the detector
  double background_adu = 0.0;     ///< subtracted where there is no dark
  double e_per_adu = 0.0;          ///< not above 0, or NaN: not known, and neither is the noise
  double read_noise_e = 0.0;
  double blur_lambda_w = 0.0;  ///< σ by which spots are wider than diffraction and pixels make them
  /// Angle from the x axis to the lenslets' columns, towards the y axis, which runs up the detector
  /// where rows_run_up.
  double rotation_rad = 0.0;
  Image<float> dark_adu;  ///< [frame rows, frame cols] or empty
  Image<float> response;  ///< [frame rows, frame cols] or empty: relative response, 0 where bad
};

/// A mode is Σ over a spot's pixels of signal·h_m(x)·h_n(y), where h are the Hermite functions of
/// .6 λ/w width about the reference. There are all modes with m + n ≤ kHighestOrder, ordered by m +
/// n and then by m.
inline constexpr int kHighestOrder = kProjectionOrders - 1;
inline constexpr int kSpotModes = (kHighestOrder + 1) * (kHighestOrder + 2) / 2;
/// The features are the modes over the flux, then the logarithm of the flux over the frame's mean,
/// photon noise and read noise over the flux, and 1.
inline constexpr int kSpotFeatures = kSpotModes + 4;

/// Pixels farther than this from the reference along an axis are left out, in units of λ/w.
inline constexpr double kModeReach = 1.75;

/// Says how one frame differs from the calibration. The maps are [rows, cols] of lenslets; null
/// stands for zeros.
struct FrameShift {
  const Image<float>* level_counts = nullptr;  ///< above the calibration's dark
  float noise_counts = 0;  ///< rms of a pixel between the spots; 0: that of the camera
  const Image<float>* spots_x_px = nullptr;  ///< the spots of a flat wave, off their references
  const Image<float>* spots_y_px = nullptr;
  const Image<float>* windows_x_px = nullptr;  ///< the windows, off their places; whole pixels
  const Image<float>* windows_y_px = nullptr;
};

/// Holds the two orders of a mode.
struct SpotMode {
  int m;
  int n;
};
SpotMode spot_mode(int index);
int spot_mode_index(SpotMode mode);

/// measure_many() writes the modes by n and then by m: feature i in spot_mode()'s order is its
/// feature kMeasuredPlaces[i].
extern const std::array<int, kSpotFeatures> kMeasuredPlaces;

/// Says how far the Hermite functions reach to either side of the reference.
struct ModeReach {
  explicit ModeReach(double reach_px);

  double px;
  int steps;  ///< These are the steps of the functions' table, rounded up.
};

/// Measures the features of spots. It is const after construction and shared by threads. Windows
/// of any size give the same features, up to kModeReach.
class SpotFeatures {
 public:
  /// Throws Failure where a window does not lie in the frame, where λ/w on the detector makes no
  /// sense, or where the frame has fewer than kProjectionLanes columns.
  SpotFeatures(const SpotCamera& camera, const FrameFormat& format);

  int rows() const { return windows_.rows(); }
  int cols() const { return windows_.cols(); }
  std::size_t lenslet_count() const { return windows_.size(); }  ///< missing ones included
  bool has_lenslet(std::size_t k) const { return windows_[k].w > 0; }

  /// Fills `features` [kSpotFeatures] of lenslet k. The two fluxes are the centroids' of this
  /// lenslet and their mean, in ADU.
  void measure(FrameView frame, const FrameShift& shift, std::size_t k, float flux_adu,
               float mean_flux_adu, float* features) const noexcept;

  /// Measures n ≤ kMaxAtOnce lenslets faster, with the logarithm to 1e-6. `features` is [n,
  /// kSpotFeatures] with room for kProjectionSlack more, in the order of kMeasuredPlaces. flux_adu
  /// is the map of all lenslets.
  void measure_many(FrameView frame, const FrameShift& shift, const std::int32_t* lenslets, int n,
                    const float* flux_adu, float mean_flux_adu, float* features) const noexcept;
  static constexpr int kMaxAtOnce = 64;

 private:
  ProjectedFrame projected(FrameView frame) const noexcept;
  /// Returns the window of lenslet k in one frame.
  ProjectedWindow placed(const FrameShift& shift, std::size_t k) const noexcept;
  /// Fills the features after the modes. In place of the logarithm it writes the argument of that.
  void add_noise(const ProjectedWindow& spot, float flux, float flux_adu, float mean_flux_adu,
                 float* features) const noexcept;

  Image<SpotWindow> windows_;
  Image<ProjectedWindow> spots_;  // the windows where the calibration has them
  ModeReach reach_;
  int frame_rows_;
  int frame_cols_;
  float read_noise_e_;          // of a pixel
  AlignedVector<float> table_;  // [steps, kProjectionLanes]
  PixelType pixel_type_;
  float e_per_count_;
  float e_per_adu_;
  float background_counts_;
  bool noise_known_;
  float row_sign_;  // sign of odd orders along y
  Image<float> dark_counts_;
  Image<float> gain_;
};

}  // namespace curlew
