#include "detect/false_alarms.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace curlew {
namespace {

constexpr int kMaxSteps = 50;  // Newton's steps below need fewer than 10.

double gaussian_density(double z) {
  return std::exp(-0.5 * z * z) / std::sqrt(2.0 * std::numbers::pi);
}

/// Returns the probability that a neighbour with correlation ρ exceeds x, given that the cell
/// itself is x. The neighbour then has mean ρx and variance 1 − ρ².
double neighbour_above(double x, double correlation) {
  return gaussian_tail((1.0 - correlation) * x / std::sqrt(1.0 - correlation * correlation));
}

/// Returns the probability that no neighbour exceeds x, given that the cell itself is x.
double no_neighbour_above(double x, CellNeighbours neighbours) {
  const double orthogonal = std::log1p(-neighbour_above(x, neighbours.orthogonal_correlation));
  const double diagonal = std::log1p(-neighbour_above(x, neighbours.diagonal_correlation));
  return std::exp(neighbours.orthogonal * orthogonal + neighbours.diagonal * diagonal);
}

}  // namespace

double gaussian_tail(double z) { return 0.5 * std::erfc(z / std::numbers::sqrt2); }

double gaussian_tail_inverse(double p) {
  if (p > 0.5) return -gaussian_tail_inverse(1.0 - p);
  // Q(z) ≤ ½·exp(−z²/2), so that this start is at or above the root. As ln Q is concave, Newton's
  // steps come down to it without overshooting.
  double z = std::sqrt(-2.0 * std::log(2.0 * p));
  for (int step = 0; step < kMaxSteps; ++step) {
    const double q = gaussian_tail(z);
    const double change = std::log(q / p) * q / gaussian_density(z);
    z += change;
    if (std::abs(change) < 1e-14 * (1.0 + z)) break;
  }
  return z;
}

double peak_probability(double z, CellNeighbours neighbours) {
  // This is Simpson's rule up to where the density has fallen by e^−36. Its 200 intervals give a
  // relative accuracy of 2e-6 for z in [0, 8].
  constexpr int kIntervals = 200;
  const double h = (std::sqrt(z * z + 72.0) - z) / kIntervals;
  double sum = 0.0;
  for (int i = 0; i <= kIntervals; ++i) {
    const double x = z + h * i;
    const double weight = i == 0 || i == kIntervals ? 1.0 : (i % 2 == 1 ? 4.0 : 2.0);
    sum += weight * gaussian_density(x) * no_neighbour_above(x, neighbours);
  }
  return sum * h / 3.0;
}

double threshold_sigmas(double rate, double n_cells, CellNeighbours neighbours) {
  if (n_cells <= 0.0) return std::numeric_limits<double>::infinity();
  const double wanted = std::max(0.5 * rate / n_cells, 1e-300);  // the least that erfc can express
  if (wanted >= peak_probability(0.0, neighbours)) return 0.0;
  double z = gaussian_tail_inverse(wanted);  // This is a little too high without neighbours.
  for (int step = 0; step < kMaxSteps; ++step) {
    const double p = peak_probability(z, neighbours);
    const double slope = gaussian_density(z) * no_neighbour_above(z, neighbours);
    const double change = std::log(p / wanted) * p / slope;
    z += change;
    if (std::abs(change) < 1e-9) break;
  }
  return z;
}

}  // namespace curlew
