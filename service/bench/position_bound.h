// How well the place of a vortex can be known at best from the spots round it.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "service/bench/field_modes.h"

namespace curlew {

/// The Fisher information about the mean of a pixel's count, per electron². The count is a Poisson
/// deviate of that mean plus Gaussian read noise, both in electrons. The information is 1/mean
/// without read noise. With read noise it is about 1/(mean + read_noise²), and more where there is
/// hardly any light: e^(1/read_noise²) − 1 at 0.
class PixelInformation {
 public:
  explicit PixelInformation(double read_noise_e);
  double operator()(double mean_e) const;

 private:
  double variance_;
  std::vector<double> products_;  ///< (mean + variance)·information, which is smooth in ln mean
};

/// The simulator's optics (LensletOptics), and how its pixels change with the field. A pixel's
/// light is a quadratic form of the field, light_p = Σ_x u(x)·½h_p(x), whose derivative is Re Σ_x
/// h_p(x)·δu(x).
class SpotDerivative {
 public:
  SpotDerivative(int samples, double pixels_per_lambda_w, int window_px);

  int window_px() const { return static_cast<int>(pixels_from_intensity_.rows()); }
  /// field: [samples, samples]. light: [pixels], for one photon in a lenslet of amplitude 1.
  /// gradient h: [pixels, points]. Pixels and points are both row by row.
  void linearise(const Eigen::MatrixXcd& field, Eigen::VectorXd& light,
                 Eigen::MatrixXcd& gradient) const;

 private:
  Eigen::MatrixXd pixels_from_intensity_;
  Eigen::MatrixXcd far_field_;  // [2·samples, samples], along one axis
};

/// The spots round one vortex, and how they change with the real and imaginary parts of the modes'
/// coefficients.
struct VortexView {
  Eigen::VectorXd light;       ///< [pixels], electrons for one photon in a lenslet of amplitude 1
  Eigen::MatrixXd derivative;  ///< of light, [pixels, 2·modes]
  /// How the vortex moves, δz = −(∂u/∂z)⁻¹ δu: [2, 2·modes], x then y, pitches.
  Eigen::Matrix2Xd displacement;
  double amplitude = 0.0;  ///< rms amplitude over the lenslets seen, which is the unit of the modes
  /// The pixels of the middle 2×2, 4×4, … lenslets are the first pixels_within[0], [1], ….
  std::vector<Eigen::Index> pixels_within;
};

/// Returns the spots of those lenslets round the vortex that are on the array of rows × cols. The
/// field must have the margin that cut_patch needs.
VortexView view_vortex(const SampledField& field, const GradedVortex& vortex, int rows, int cols,
                       const FieldModes& modes, const SpotDerivative& spots);

/// Returns the bound: the covariance of the vortex's place, pitches², once the spots of the middle
/// `lenslets`² have been seen. There is one for each of `photons` (of a lenslet of amplitude 1;
/// infinite: the limit of many, without read noise). It is D (1 + AᵀWA)⁻¹ Dᵀ, with A = derivative,
/// D = displacement, W = photons² times the pixels' information, and 1 the covariance that the
/// coefficients have before any spot is seen.
///
/// This is what a linear estimate would reach if it knew the field except for the modes, each drawn
/// from its Gaussian. So the bound is too low wherever the spots leave a choice between fields that
/// are far apart, and where the light is not linear within the error (H. L. Van Trees, Detection,
/// Estimation, and Modulation Theory I, 1968, section 2.4). Only knowledge of the fields beyond
/// their covariance could beat it.
std::vector<Eigen::Matrix2d> position_covariances(const VortexView& view, int lenslets,
                                                  const std::vector<double>& photons,
                                                  const PixelInformation& information);

/// A Gaussian error of a given covariance; errors beyond `radius` are left out.
struct TruncatedError {
  double probability = 0.0;  ///< probability of an error within the radius
  double square = 0.0;       ///< mean square of the errors within the radius
};
/// Returns what is left of such an error. covariance: pitches²; radius: pitches.
TruncatedError truncate_error(const Eigen::Matrix2d& covariance, double radius);

}  // namespace curlew
