// LensletOptics turns the field over one lenslet into its far field on the detector's pixels.
#pragma once

#include <Eigen/Core>
#include <complex>
#include <unsupported/Eigen/FFT>

#include "core/image.h"

namespace curlew {

/// Returns B, [patch_px, 2·samples], with pixels = B·I·Bᵀ: I is the far-field intensity at every ½
/// λ/w of a lenslet of samples × samples points, and B integrates it over the pixels of a centred
/// patch.
Eigen::MatrixXd integrate_pixels(int samples, double pixels_per_lambda_w, int patch_px);

/// Computes the far field of one square lenslet, integrated over square pixels.
///
/// The field is given as samples × samples points, point i at (i + ½)/samples of the lenslet. An
/// FFT padded to twice that samples the intensity at every ½ λ/w, which is all there is to know:
/// the intensity is band-limited (its transform, the field's autocorrelation, ends at one pitch).
/// Interpolating and integrating it over a pixel is therefore one small real matrix per axis, and
/// exact: there is no pixel integration error, whatever the pixels' size. What remains is that
/// point samples make the far field periodic, with a period of `samples` λ/w: the first side lobes
/// of the spot are too bright by (πu/samples)²/3 at u λ/w from its centre (.7 % at 1.5 λ/w, 32).
///
/// The far field is E(u) = ∫ field(x)·exp(−2πi u·x) dx, so a phase slope of s rad per pitch moves
/// the spot by +s/2π λ/w.
class LensletOptics {
 public:
  /// samples: field points per lenslet side. pixels_per_lambda_w: pixels per λ/w in the focus.
  /// patch_px: pixels per side of the patch that is computed, centred on the optical axis. Throws
  /// UsageError if the patch is wider than the far field's period.
  LensletOptics(int samples, double pixels_per_lambda_w, int patch_px);

  int samples() const { return samples_; }
  int patch_px() const { return patch_px_; }

  /// field: [samples, samples]. patch: [patch_px, patch_px], overwritten with each pixel's share of
  /// the power; over a patch as wide as the period the sum is the mean of |field|² (Parseval).
  void propagate(const Image<std::complex<double>>& field, Image<double>& patch);

 private:
  int samples_;
  int patch_px_;
  Eigen::FFT<double> fft_;
  Eigen::VectorXcd line_;                  ///< [2·samples] one row or column, zero padded
  Eigen::VectorXcd spectrum_;              ///< [2·samples]
  Eigen::MatrixXcd half_transformed_;      ///< [y, frequency along x] = [samples, 2·samples]
  Eigen::MatrixXd intensity_;              ///< [frequency along y, along x], spaced ½ λ/w
  Eigen::MatrixXd pixels_from_intensity_;  ///< [patch_px, 2·samples]
  Eigen::MatrixXd patch_;                  ///< [patch_px, patch_px]
};

}  // namespace curlew
