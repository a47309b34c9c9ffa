// How well the place of a vortex can be known at best from the spots round it.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "service/bench/field_modes.h"

namespace curlew {

/// Fisher information about the mean of a pixel's count, per electron²: of a Poisson deviate of
/// that mean and Gaussian read noise, both in electrons. 1/mean without read noise; with it about
/// 1/(mean + read_noise²), and more where there is hardly any light: e^(1/read_noise²) − 1 at 0.
class PixelInformation {
 public:
  explicit PixelInformation(double read_noise_e);
  double operator()(double mean_e) const;

 private:
  double variance_;
  std::vector<double> products_;  ///< (mean + variance)·information, which is smooth in ln mean
};

/// The simulator's optics (LensletOptics) and how its pixels change with the field: a pixel's light
/// is a quadratic form of the field, light_p = Σ_x u(x)·½h_p(x), whose derivative is Re Σ_x
/// h_p(x)·δu(x).
class SpotDerivative {
 public:
  SpotDerivative(int samples, double pixels_per_lambda_w, int window_px);

  int window_px() const { return static_cast<int>(pixels_from_intensity_.rows()); }
  /// field: [samples, samples]. light: [pixels], for one photon a lenslet of amplitude 1;
  /// gradient h: [pixels, points], both row by row.
  void linearise(const Eigen::MatrixXcd& field, Eigen::VectorXd& light,
                 Eigen::MatrixXcd& gradient) const;

 private:
  Eigen::MatrixXd pixels_from_intensity_;
  Eigen::MatrixXcd far_field_;  // [2·samples, samples]: along one axis
};

/// The spots round one vortex and how they change with the modes' coefficients, both parts of each.
struct VortexView {
  Eigen::VectorXd light;       ///< [pixels], electrons for one photon a lenslet of amplitude 1
  Eigen::MatrixXd derivative;  ///< [pixels, 2·modes], of light
  /// [2, 2·modes], x then y, pitches: where the vortex goes, δz = −(∂u/∂z)⁻¹ δu.
  Eigen::Matrix2Xd displacement;
  double amplitude = 0.0;  ///< rms, of the lenslets seen: what the modes are in units of
  /// The pixels of the middle 2×2, 4×4, … lenslets are the first pixels_within[0], [1], ….
  std::vector<Eigen::Index> pixels_within;
};

/// The spots of those lenslets round the vortex that are on the array of rows × cols. The field has
/// a margin as cut_patch wants it.
VortexView view_vortex(const SampledField& field, const GradedVortex& vortex, int rows, int cols,
                       const FieldModes& modes, const SpotDerivative& spots);

/// The bound: covariance of the vortex's place, pitches², once the spots of the middle `lenslets`²
/// have been seen, at each of `photons` (a lenslet of amplitude 1; infinite: the limit of many,
/// without read noise): D (1 + AᵀWA)⁻¹ Dᵀ, A = derivative, D = displacement, W = photons² times the
/// pixels' information, 1 the coefficients' own (their variance).
///
/// What a linear estimate would reach that knows the field but for the modes, each drawn from its
/// Gaussian. So it says too little wherever the spots leave a choice between far-apart fields, and
/// where the light bends within the error (H. L. Van Trees, Detection, Estimation, and Modulation
/// Theory I, 1968, section 2.4). Only what is known of fields beyond their covariance could beat
/// it.
std::vector<Eigen::Matrix2d> position_covariances(const VortexView& view, int lenslets,
                                                  const std::vector<double>& photons,
                                                  const PixelInformation& information);

/// A Gaussian error of that covariance, those beyond `radius` left out.
struct TruncatedError {
  double probability = 0.0;  ///< of an error within the radius
  double square = 0.0;       ///< mean square of those
};
TruncatedError truncate_error(const Eigen::Matrix2d& covariance, double radius);

}  // namespace curlew
