// The field round a vortex as a sum of modes, which are learnt from simulated fields.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "acquisition/simulator/field.h"
#include "service/bench/detection_dataset.h"
#include "service/bench/detection_score.h"

namespace curlew {

/// Returns the propagated field of a realisation with its margin: all that simulate_realisation()
/// turns into light, and more round it. Throws as Simulator does.
SampledField simulate_true_field(const FieldParameters& parameters, std::uint64_t seed);

/// Returns all points [y, x] of the field over `lenslets`² lenslets (an even number a side) round
/// the vortex's node at (floor(x) + ½, floor(y) + ½). The patch is mirrored in x if the charge is
/// negative, so that every patch has a positive vortex within half a pitch of its middle along
/// either axis. The field's margin must reach that far.
Eigen::MatrixXcd cut_patch(const SampledField& field, const GradedVortex& vortex, int lenslets);

/// A patch, in units of its own rms amplitude, is Σ c_k b_k, where the c_k are independent complex
/// numbers whose real and imaginary parts have variance 1. The b_k are the Karhunen–Loève modes of
/// the patches, each times its standard deviation, the strongest first. The phase of a whole patch
/// is free.
struct FieldModes {
  int lenslets = 0;    ///< along a side of a patch
  int samples = 0;     ///< points along a lenslet's side
  double power = 0.0;  ///< part of the patches' mean power that the modes hold
  int patches = 0;     ///< patches learnt from, each in four orientations
  /// The modes: [lenslet (row·lenslets + col)] of [point of the lenslet (row·samples + col), mode].
  std::vector<Eigen::MatrixXcd> values;

  Eigen::Index count() const { return values.empty() ? 0 : values.front().cols(); }
};

/// Learns modes from patches. Each patch is turned by 0, 90, 180 and 270 degrees, which keeps the
/// charge. The modes are sought among products of `polynomials` Legendre polynomials along each
/// axis.
class FieldModeEstimator {
 public:
  FieldModeEstimator(int lenslets, int samples, int polynomials);

  /// Adds the required vortices in the interior of an array of rows × cols lenslets.
  void add(const SampledField& field, const std::vector<GradedVortex>& vortices, int rows,
           int cols);

  /// Returns the `count` strongest modes, or all there are. Throws Failure if there were no
  /// patches.
  FieldModes modes(int count) const;

 private:
  int lenslets_;
  int samples_;
  int patches_ = 0;
  Eigen::MatrixXd polynomials_;  // [points along an axis, n], orthonormal
  Eigen::MatrixXcd covariance_;  // [n², n²], summed over what was added; only the lower half
};

}  // namespace curlew
