// AirPlan holds what turbulence of known strength would do to the slopes of a sensor.
#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "core/image.h"
#include "reconstruct/air/air_options.h"
#include "reconstruct/modes/mode_fit.h"

namespace curlew {

/// Turbulence is Kolmogorov's, with the spectrum .0229 r0^(−5/3) f^(−11/3) of phase; f is in cycles
/// a pitch and r0 in pitches. A slope is the mean gradient over a square lenslet. Const after
/// construction.
class AirPlan {
 public:
  /// lit: [rows, cols], non-zero where a lenslet is lit.
  AirPlan(const Image<std::uint8_t>& lit, const AirOptions& options);

  const Image<std::uint8_t>& lit() const { return lit_; }
  const ModePlan& modes() const { return modes_; }

  /// Pairs of lenslets so many pitches apart, in a row or a column, are compared: a quarter of the
  /// lesser side, and 1 at least. What the whole array does together takes no part.
  int separation() const { return separation_; }
  /// Half of the mean square by which slopes of such a pair differ where r0 is one pitch, rad².
  double pair_variance() const { return pair_variance_; }

  /// Modes [first, first + count) of modes() have radial orders 2 and 3 (Noll 4 to 10); fewer where
  /// the lenslets do not allow them.
  static constexpr int kFirstMode = 2;
  int mode_count() const { return static_cast<int>(mode_variance_.size()); }
  /// Their variances as they are fitted where r0 is one pitch, rad²: what higher modes add is in
  /// them.
  const Eigen::VectorXd& mode_variance() const { return mode_variance_; }

 private:
  double spectrum(double f) const;
  void find_pair_variance();
  void find_mode_variance();

  Image<std::uint8_t> lit_;
  ModePlan modes_;
  double fresnel_;
  int separation_;
  double pair_variance_ = 0.0;
  Eigen::VectorXd mode_variance_;
};

}  // namespace curlew
