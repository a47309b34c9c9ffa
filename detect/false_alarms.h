// This file declares the step from a stated rate of false alarms per frame to a threshold in
// standard deviations.
#pragma once

namespace curlew {

/// Says how many neighbours a cell has on average (4 and 4 inside a pupil, fewer on its rim), and
/// how the tested quantity correlates with that of the neighbours in white slope noise. The
/// defaults are the correlations of D.
struct CellNeighbours {
  double orthogonal = 4.0;
  double diagonal = 4.0;
  double orthogonal_correlation = 0.0;
  double diagonal_correlation = -0.25;
};

/// Returns Q(z), the probability that a standard normal variable exceeds z.
double gaussian_tail(double z);

/// Returns z with Q(z) = p, to double precision; p must be in (0, 1).
double gaussian_tail_inverse(double p);

/// Returns the probability that in white slope noise a cell's D exceeds z·σ_D and also the D of
/// every neighbour. The neighbours are taken as independent of each other once the cell's D is
/// given.
double peak_probability(double z, CellNeighbours neighbours);

/// Returns the threshold z, in units of σ_D, at which white noise makes `rate` local extrema of
/// either sign per frame of n_cells cells: 2·n_cells·peak_probability(z) = rate. Where few false
/// alarms are allowed in many cells, this is 2·n_cells·Q(z) = rate. The threshold is 0 where the
/// rate is more than noise can make, and +infinity where n_cells is 0. `rate` must be more than 0.
/// Noise with other than Gaussian tails would be accounted for here and nowhere else.
double threshold_sigmas(double rate, double n_cells, CellNeighbours neighbours = {});

}  // namespace curlew
