// Positions by another method than the threshold's: weighted, correlation, brightest pixels and
// maximum likelihood.
#pragma once

#include "centroiding/centroid.h"

namespace curlew {

/// The widest window, in pixels a side, that these methods take.
inline constexpr int kMaxMethodWindow = 48;
inline constexpr int kMaxBrightestPixels = 64;

/// Goes over what the threshold's kernel found in lenslet rows [first, last) and puts positions and
/// their noise by plan.method in its place; flux and second moments stay those above the threshold.
/// All pixels of the window count here, I = gain·(count − dark), not only those above T.
///
/// - kWeighted (M. Nicolle et al., Opt. Lett. 29, 2743, 2004; here the weight follows the spot):
///   three steps x ← x + (Σ I·g·(p − x) − c·(x − r))/(Σ I·g + c), g the Gaussian
///   exp(−(p − x)²/2s²), r the reference, c = reference_pull; begun half-way between reference and
///   threshold's centroid. Its fixed point is the peak of the correlation of I with g less a
///   parabola about the reference: the maximum a posteriori where slopes are Gaussian.
/// - kCorrelation (S. Thomas et al., MNRAS 371, 323, 2006): brightest pixel of the correlation with
///   g, then a parabola through its logarithm and the neighbours' (where these are not positive,
///   through itself; none at the window's edge).
/// - kBrightestPixels (A. G. Basden et al., MNRAS 419, 1628, 2012): the threshold's centroid with
///   the brightness of the (n + 1)-th brightest pixel for T.
/// - kMaximumLikelihood: μ = F·g + b, Fisher scoring over F, b, x, y with the variances
///   σ² + k·μ of read and photon noise, six steps from where kWeighted without pull ends.
///
/// Variances: of first order through these equations for the pixels' variances σ² + k·I; for
/// kMaximumLikelihood the inverse of the Fisher information. 0 where the noise is not known.
///
/// States: a lenslet is faint where its signal under the method (Σ I·g, correlation, Σ v or F) is
/// below min_snr of its own noise, whatever the threshold said. Where the threshold found it faint,
/// the moments are the Gaussian's, and where no pixel exceeds T the flux is that of a Gaussian spot
/// of the method's signal.
void find_positions(const CentroidPlan& plan, FrameView frame, int first, int last,
                    Centroids& centroids) noexcept;

}  // namespace curlew
