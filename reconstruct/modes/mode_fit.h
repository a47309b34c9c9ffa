// Zernike coefficients of a wavefront, by least squares on its slopes.
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "core/image.h"
#include "core/slope_field.h"
#include "core/zernike.h"
#include "reconstruct/modes/zernike_pupil.h"

namespace curlew {

/// How the coefficients of the modes follow from the slopes: c = Σ x·s_x + y·s_y over lenslets.
struct ModeResponse {
  std::vector<std::size_t> lenslets;  ///< indices k of the lit ones
  Eigen::MatrixXd x;                  ///< [modes, lit lenslets], rad for a slope of 1 rad a pitch
  Eigen::MatrixXd y;
};

/// The modes are Noll's polynomials from j = 2 on, over a disc, or over an annulus orthonormalised
/// in Noll's order (V. N. Mahajan, J. Opt. Soc. Am. 71, 75 (1981)). Each has mean square 1 over the
/// pupil. Const after construction.
class ModePlan {
 public:
  /// valid: [rows, cols], non-zero where a lenslet is lit. last_noll: the last j that is wanted; it
  /// is lowered to the last j of whole radial orders for which there are two lenslets a mode.
  ModePlan(const Image<std::uint8_t>& valid, int last_noll);

  const ZernikePupil& pupil() const { return pupil_; }
  /// How many modes there are, from j = 2 on; it may be 0.
  int modes() const { return static_cast<int>(zernikes_.size()); }
  /// The polynomial of mode i, over the disc.
  const Zernike& zernike(int i) const { return zernikes_[static_cast<std::size_t>(i)]; }
  /// Sets x and y of the lit lenslets to the slopes of 1 rad of mode i, over the disc.
  void put_slopes(int i, SlopeField& slopes) const;
  /// Returns how the coefficients follow where no lenslet is missing; of no lenslets where the lit
  /// ones do not tell the modes apart.
  ModeResponse response() const;

 private:
  friend class ModeFit;

  Eigen::VectorXd values(double x, double y) const;
  void find_slopes(const Image<std::uint8_t>& valid);
  void orthonormalise();

  ZernikePupil pupil_;
  std::vector<Zernike> zernikes_;
  std::vector<std::size_t> lenslets_;  ///< indices of the lit ones
  Eigen::MatrixXd slopes_x_;           ///< [mode, lit lenslet], rad a pitch for 1 rad of the mode
  Eigen::MatrixXd slopes_y_;
  Eigen::MatrixXd normal_;  ///< Σ over the lit lenslets of the products of slopes
  /// Turns coefficients of the disc's modes into those of the annulus's; upper triangular.
  Eigen::MatrixXd annular_from_disc_;
};

/// Fits frame after frame, and allocates nothing while it does.
class ModeFit {
 public:
  explicit ModeFit(const ModePlan& plan);

  /// Fits all modes to the valid slopes, all with the same weight: the model's slope of a lenslet
  /// is the mean gradient of the mode over its square, times the pitch. Returns false, and makes
  /// all coefficients NaN, if the lenslets that are left do not tell the modes apart.
  bool fit(const SlopeField& slopes) noexcept;

  /// Coefficients in rad rms, [modes].
  const Eigen::VectorXd& coefficients() const { return coefficients_; }
  /// The same fit in the modes of the disc, if the last fit() was one.
  const Eigen::VectorXd& disc_coefficients() const { return right_; }

  /// Call it after fit() with the same slopes. Returns the standard errors of the coefficients,
  /// [modes], rad rms, as they follow from the slopes' variances; NaN where fit() gave none. What
  /// modes beyond the last one add to the coefficients is not in them.
  const Eigen::VectorXd& find_errors(const SlopeField& slopes) noexcept;

 private:
  const ModePlan& plan_;
  Eigen::LLT<Eigen::MatrixXd> factor_of_all_;
  Eigen::LLT<Eigen::MatrixXd> factor_;
  Eigen::MatrixXd normal_;
  Eigen::VectorXd right_;
  Eigen::VectorXd coefficients_;
  bool fitted_ = false;
  bool all_ = true;  ///< no lenslet was missing in the last fit
  ModeResponse response_of_all_;
  Eigen::MatrixXd inverse_;  ///< of the normal matrix, times annular_from_disc_ from the left
  Eigen::MatrixXd solved_;
  Eigen::VectorXd column_x_;
  Eigen::VectorXd column_y_;
  Eigen::VectorXd errors_;
};

}  // namespace curlew
