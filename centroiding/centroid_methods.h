// This file declares the centroid methods that do more than threshold: weighted, correlation,
// brightest pixels and maximum likelihood.
#pragma once

#include "centroiding/centroid.h"

namespace curlew {

/// These methods take windows of at most so many pixels a side.
inline constexpr int kMaxMethodWindow = 48;
inline constexpr int kMaxBrightestPixels = 64;

/// Replaces the positions and their noise in lenslet rows [first, last), which the threshold's
/// kernel has measured, by those of plan.method. Flux and second moments stay those above the
/// threshold. Lenslets that are saturated, at their window's edge or bad keep what the kernel
/// found. `conditions` are those of find_centroids(). In this step all pixels of the window count,
/// I = gain·(count − dark), and not only those above T. Here p is a pixel, g the Gaussian exp(−(p −
/// x)²/2s²) about the position x, and r the reference.
///
/// - kWeighted (M. Nicolle et al., Opt. Lett. 29, 2743, 2004; here the weight follows the spot)
///   makes three steps x ← x + (Σ I·g·(p − x) − c·(x − r))/(Σ I·g + c) with c = reference_pull. It
///   starts half-way between the reference and the threshold's centroid. Its fixed point is the
///   peak of the correlation of I with g less a parabola about the reference, which is the maximum
///   a posteriori where slopes are Gaussian.
/// - kCorrelation (S. Thomas et al., MNRAS 371, 323, 2006) takes the brightest pixel of the
///   correlation with g and fits a parabola to the logarithms of this pixel and its neighbours.
///   Where one of them is not positive it fits the values themselves, and at the window's edge it
///   fits none.
/// - kBrightestPixels (A. G. Basden et al., MNRAS 419, 1628, 2012) is the threshold's centroid with
///   the brightness of the (n + 1)-th brightest pixel for T.
/// - kMaximumLikelihood fits μ = F·g + b. It makes six steps of Fisher scoring over F, b, x and y
///   with the variances σ² + k·μ of read and photon noise, and starts where kWeighted without pull
///   ends.
///
/// The variances are of first order, and follow through these equations from the pixels' variances
/// σ² + k·I. For kMaximumLikelihood they are the inverse of the Fisher information. They are 0
/// where the noise is not known.
///
/// A lenslet is faint where its signal under the method (Σ I·g, the correlation, Σ v or F) is below
/// min_snr times its own noise, whether or not the threshold found it faint. Where the threshold
/// found it faint, the moments are the Gaussian's. Where no pixel exceeds T, the flux is that of a
/// Gaussian spot with the method's signal.
void find_positions(const CentroidPlan& plan, FrameView frame, int first, int last,
                    Centroids& centroids, const FrameConditions& conditions) noexcept;

}  // namespace curlew
