// This file declares the steps of the split that go over the rows of the lattice.
//
// All working arrays are laid out as SplitGrid says and are 0 where there is no lenslet or corner.
#pragma once

#include "core/hodge_split.h"
#include "core/slope_field.h"
#include "reconstruct/split_grid.h"

namespace curlew {

/// This is what goes over all lenslets that are in a frame's fit.
struct FitSums {
  int n = 0;         ///< how many they are
  float mean_x = 0;  ///< mean slope
  float mean_y = 0;
  float weight = 0;            ///< sum of their weights
  bool noise_is_known = true;  ///< whether every one has a variance above 0 and finite
};

/// Sets the weights: 0 where a lenslet is not in the fit, elsewhere 1, or the inverse of the mean
/// variance of its two slopes. `lit` is 1 where the pupil has a lenslet.
FitSums weigh_lenslets(const SplitGrid& grid, const float* lit, const SlopeField& slopes,
                       bool by_variance, float* weight) noexcept;

/// Sets the edges A and B to the slopes less their mean, which is a plane and so exactly a
/// gradient. Weights are multiplied by `scale`, within limits. Returns the largest edge.
float load_edges(const SplitGrid& grid, const SlopeField& slopes, const FitSums& sums, float scale,
                 float* weight, float* edge_a, float* edge_b) noexcept;

/// Computes divergence = Γᵀ·edge at the corners, for weights of 1.
void find_divergence(const SplitGrid& grid, const float* edge_a, const float* edge_b,
                     float* divergence) noexcept;

/// Computes residual = ΓᵀW·(edge − Γφ) at the corners. φ is double, and so are the sums.
void find_residual(const SplitGrid& grid, const float* weight, const float* edge_a,
                   const float* edge_b, const double* phi, float* residual) noexcept;

/// Adds `step` to φ, and returns the largest change of an edge that is in the fit.
float add_step(const SplitGrid& grid, const float* weight, const float* step, double* phi) noexcept;

/// Stores the curl-free slopes Γφ, what is left of the slopes, and φ at the lenslets' centres. The
/// edges then hold w·e of the solenoidal part. Returns the sum of the phase.
float store_slopes(const SplitGrid& grid, const SlopeField& slopes, const FitSums& sums,
                   const float* weight, const float* phi, float* edge_a, float* edge_b,
                   HodgeSplit& split) noexcept;

/// Subtracts the mean from the phase of all lenslets that are in the fit.
void subtract_mean(const SplitGrid& grid, const float* weight, float mean,
                   HodgeSplit& split) noexcept;

/// Computes one row of ψ at the corners from the row above and the edges between them: from the
/// upper left where from_left is 1, and from the upper right where from_right is 1.
void find_potential_row(const SplitGrid& grid, int row, const float* from_left,
                        const float* from_right, const float* edge_a, const float* edge_b,
                        float* psi) noexcept;

}  // namespace curlew
