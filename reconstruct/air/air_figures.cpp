#include "reconstruct/air/air_figures.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace curlew {
namespace {

constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

/// The values of all figures, in the order of `all_of`.
using Values = Eigen::Array<double, 9, 1>;

std::vector<AirFigure*> all_of(AirFigures& f) {
  return {&f.r0_slopes, &f.r0_zernike,    &f.scintillation, &f.wind_x,        &f.wind_y,
          &f.tau0,      &f.vortex_wind_x, &f.vortex_wind_y, &f.vortex_density};
}

/// Variances grow with r0^(−5/3). variance: by what r0 = 1 would make it.
double r0_of(double variance) { return variance > 0.0 ? std::pow(variance, -3.0 / 5.0) : kUnknown; }

double r0_by_slopes(const AirPlan& plan, const AirSums& sums) {
  if (sums.pairs == 0) return kUnknown;
  return r0_of((sums.pair_square - sums.pair_noise) / static_cast<double>(sums.pairs) /
               plan.pair_variance());
}

/// Each mode's variance by its own measure, so that all count alike.
double r0_by_modes(const AirPlan& plan, const AirSums& sums) {
  if (sums.mode_frames == 0 || plan.mode_count() == 0) return kUnknown;
  const Eigen::ArrayXd variance =
      (sums.mode_square - sums.mode_noise) / static_cast<double>(sums.mode_frames);
  return r0_of((variance / plan.mode_variance().array()).mean());
}

/// ⟨I²⟩/⟨I⟩² − 1 of each lenslet, less what noise makes of it, averaged over the lenslets.
double scintillation_of(const AirSums& sums) {
  double sum = 0.0;
  double lenslets = 0.0;
  for (Eigen::Index k = 0; k < sums.light.size(); ++k) {
    const double n = sums.light_count[k];
    if (n < 2.0 || !(sums.light[k] > 0.0)) continue;
    const double mean = sums.light[k] / n;
    const double variance =
        (sums.light_square[k] - n * mean * mean) / (n - 1.0) - sums.light_noise[k] / n;
    sum += variance / (mean * mean);
    lenslets += 1.0;
  }
  return lenslets > 0.0 ? sum / lenslets : kUnknown;
}

/// Takes from the mean products what lenslets do in all frames, so that only the air is left.
Eigen::ArrayXXd covariance_of(const AirPlan& plan, const AirSums& sums, std::size_t lag) {
  const int rows = plan.lit().rows();
  const int cols = plan.lit().cols();
  const Eigen::ArrayXd count = sums.slope_count.max(1.0);
  const Eigen::ArrayXd x = sums.slope_x / count;
  const Eigen::ArrayXd y = sums.slope_y / count;
  Eigen::ArrayXXd covariance = sums.products[lag] / sums.product_count[lag].max(1.0);
  for (int down = -kFarthestMove; down <= kFarthestMove; ++down)
    for (int right = -kFarthestMove; right <= kFarthestMove; ++right) {
      double product = 0.0;
      double pairs = 0.0;
      for (int row = std::max(0, -down); row < std::min(rows, rows - down); ++row)
        for (int col = std::max(0, -right); col < std::min(cols, cols - right); ++col) {
          const Eigen::Index a = row * cols + col;
          const Eigen::Index b = (row + down) * cols + col + right;
          if (sums.slope_count[a] == 0.0 || sums.slope_count[b] == 0.0) continue;
          product += x[a] * x[b] + y[a] * y[b];
          pairs += 1.0;
        }
      covariance(down + kFarthestMove, right + kFarthestMove) -= product / std::max(pairs, 1.0);
    }
  return covariance;
}

struct Move {
  double x = 0.0;
  double y = 0.0;
  double height = 0.0;  ///< covariance at the peak
  bool found = false;
};

/// Where a parabola through three values has its highest point, from the middle one.
double vertex(double before, double middle, double after) {
  const double bend = 2.0 * middle - before - after;
  return bend > 0.0 ? std::clamp(0.5 * (after - before) / bend, -0.5, 0.5) : 0.0;
}

/// Returns where the covariance is highest; not found at the border of what was looked at.
Move highest(const Eigen::ArrayXXd& covariance) {
  Eigen::Index row = 0;
  Eigen::Index col = 0;
  const double peak = covariance.maxCoeff(&row, &col);
  if (row == 0 || col == 0 || row == kMoves - 1 || col == kMoves - 1) return {};
  return {static_cast<double>(col - kFarthestMove) +
              vertex(covariance(row, col - 1), peak, covariance(row, col + 1)),
          static_cast<double>(row - kFarthestMove) +
              vertex(covariance(row - 1, col), peak, covariance(row + 1, col)),
          peak, true};
}

/// Returns the wind in pitches a second, by the moves after several lags. Each is weighted by how
/// alike the patterns still are and by the lag. A longer lag counts as long as the pattern is still
/// in sight, and where the shorter ones let one expect it; below kAlike it is taken for lost.
std::pair<double, double> wind_of(const AirPlan& plan, const AirSums& sums) {
  constexpr double kAlike = 0.15;
  constexpr double kNear = 1.0;
  const double slopes = sums.slope_count.sum();
  if (sums.steps == 0 || slopes == 0.0 || !(sums.slope_square > 0.0)) return {kUnknown, kUnknown};
  const double step_s = sums.seconds / static_cast<double>(sums.steps);
  const double variance = sums.slope_square / slopes;
  double x = 0.0;
  double y = 0.0;
  double weight = 0.0;
  for (std::size_t lag = 0; lag < kLags.size(); ++lag) {
    if (sums.product_count[lag].maxCoeff() <= 0.0) continue;
    const Move move = highest(covariance_of(plan, sums, lag));
    const double alike = move.height / variance;
    const double time = step_s * static_cast<double>(kLags[lag]);
    if (!move.found || alike < kAlike) break;
    if (weight > 0.0 && std::hypot(move.x - x / weight * time, move.y - y / weight * time) > kNear)
      break;
    x += alike * time * move.x;
    y += alike * time * move.y;
    weight += alike * time * time;
  }
  if (weight == 0.0) return {kUnknown, kUnknown};
  return {x / weight, y / weight};
}

/// The coherence time of a frozen pattern that drifts (F. Roddier, Prog. Opt. 19, 281, 1981).
double tau0_of(double r0, double wind_x, double wind_y) {
  const double speed = std::hypot(wind_x, wind_y);
  return speed > 0.0 ? 0.314 * r0 / speed : kUnknown;
}

double ratio(double a, double b) { return b > 0.0 ? a / b : kUnknown; }

Values values_of(const AirPlan& plan, const AirSums& sums) {
  const double r0 = r0_by_slopes(plan, sums);
  const auto [wind_x, wind_y] = wind_of(plan, sums);
  const auto tracked = static_cast<double>(sums.tracked);
  Values values;
  values << r0, r0_by_modes(plan, sums), scintillation_of(sums), wind_x, wind_y,
      tau0_of(r0, wind_x, wind_y), ratio(sums.vortex_vx, tracked), ratio(sums.vortex_vy, tracked),
      ratio(static_cast<double>(sums.vortices), sums.lenslets);
  return values;
}

}  // namespace

AirFigures air_figures(const AirPlan& plan, const std::vector<AirSums>& blocks) {
  AirFigures figures;
  if (blocks.empty()) return figures;
  AirSums all(plan);
  for (const AirSums& block : blocks) all += block;
  figures.frames = all.frames;
  figures.seconds = all.seconds;
  const Values values = values_of(plan, all);
  const auto n = static_cast<double>(blocks.size());
  std::vector<Values> without;
  Values mean = Values::Zero();
  for (const AirSums& block : blocks) {
    AirSums rest = all;
    rest -= block;
    without.push_back(values_of(plan, rest));
    mean += without.back() / n;
  }
  Values square = Values::Zero();
  for (const Values& rest : without) square += (rest - mean).square();
  const Values errors = (square * ((n - 1.0) / n)).sqrt();
  const std::vector<AirFigure*> members = all_of(figures);
  for (std::size_t i = 0; i < members.size(); ++i) {
    const auto at = static_cast<Eigen::Index>(i);
    *members[i] = {values[at], n > 1.0 ? errors[at] : kUnknown};
  }
  return figures;
}

void AirWindow::add(const AirSample& sample) {
  if (blocks_.empty() || blocks_.back().frames == block_frames_) {
    if (blocks_.size() == kMostBlocks) {  // two and two become one
      for (std::size_t i = 0; i < kMostBlocks / 2; ++i) {
        AirSums both = std::move(blocks_[2 * i]);
        both += blocks_[2 * i + 1];
        blocks_[i] = std::move(both);
      }
      blocks_.erase(blocks_.begin() + kMostBlocks / 2, blocks_.end());
      block_frames_ *= 2;
    }
    blocks_.emplace_back(plan_);
  }
  collector_.add(sample, blocks_.back());
}

void AirWindow::begin_anew() {
  blocks_.clear();
  block_frames_ = 1;
}

}  // namespace curlew
