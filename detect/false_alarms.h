// False alarms: from a stated rate per frame to a threshold in standard deviations.
#pragma once

namespace curlew {

/// How many neighbours a cell has on average: 4 and 4 inside a pupil, fewer on its rim. And how
/// what is tested at a cell, D unless said, correlates with theirs in white slope noise.
struct CellNeighbours {
  double orthogonal = 4.0;
  double diagonal = 4.0;
  double orthogonal_correlation = 0.0;
  double diagonal_correlation = -0.25;
};

/// Q(z), the probability that a standard normal variable exceeds z.
double gaussian_tail(double z);

/// z with Q(z) = p, to double precision; p in (0, 1).
double gaussian_tail_inverse(double p);

/// Probability that a cell's D exceeds z·σ_D and every one of its neighbours' D, in white slope
/// noise. The neighbours are taken as independent of each other once the cell's D is given.
double peak_probability(double z, CellNeighbours neighbours);

/// The threshold z, in units of σ_D, at which white noise makes `rate` local extrema of either sign
/// per frame of n_cells cells: 2·n_cells·peak_probability(z) = rate. Where few false alarms are
/// asked of many cells this is 2·n_cells·Q(z) = rate. 0 where the rate is more than noise can
/// make, +infinity where n_cells is 0. Needs rate > 0. This is the one place where noise with other
/// than Gaussian tails would be accounted for.
double threshold_sigmas(double rate, double n_cells, CellNeighbours neighbours = {});

}  // namespace curlew
