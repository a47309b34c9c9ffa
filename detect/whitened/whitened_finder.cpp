#include "detect/whitened/whitened_finder.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>

#include "core/error.h"
#include "core/size_check.h"
#include "detect/circulation.h"
#include "detect/false_alarms.h"

namespace curlew {
namespace {

using Sighting = WhitenedWorkspace::Sighting;

constexpr float kMinLog = 1e-3F;             // rad²; less noise counts as none
constexpr float kFirstLookPart = 0.7F;       // of the threshold, for a t that knows flux alone
constexpr int kPairReach = 2;                // nodes along an axis between the two of a pair
constexpr float kWidestPair = 1.25F;         // pitches
constexpr float kAlike = 0.6F;               // least ratio of the z of the two of a pair
constexpr float kMaxVariance = 1.0F / 3.0F;  // pitches²; a position anywhere within a pitch has it

void check(const WhitenedOptions& options) {
  if (!(options.min_probability > 0.0 && options.min_probability < 1.0)) {
    throw UsageError("the least probability is " + std::to_string(options.min_probability) +
                     "; give a number between 0 and 1, such as 0.5");
  }
  if (!(options.slope_clutter_rad2 > 0.0) || !std::isfinite(options.slope_clutter_rad2)) {
    throw UsageError("the clutter of slopes is " + std::to_string(options.slope_clutter_rad2) +
                     " rad²; give a number above 0, such as 0.7");
  }
  if (!(options.log_odds_per_sigma > 0.0)) {
    throw UsageError("the log odds per sigma are " + std::to_string(options.log_odds_per_sigma) +
                     "; give a number above 0, such as 4");
  }
  if (!(options.pair_sigmas >= 0.0)) {
    throw UsageError("the standard deviations that tell a pair apart are " +
                     std::to_string(options.pair_sigmas) + "; give 0 or more, such as 2");
  }
}

/// Returns whether three or four of node (r, c)'s lenslets are there.
bool is_node(const Image<std::uint8_t>& valid, int r, int c) noexcept {
  int n = 0;
  for (int i = r; i <= r + 1; ++i)
    for (int j = c; j <= c + 1; ++j) n += valid.contains(i, j) && valid(i, j) != 0 ? 1 : 0;
  return n >= 3;
}

/// Returns how t of neighbouring nodes correlates in white slope noise.
CellNeighbours correlate(const VortexPattern& pattern) {
  constexpr int kSize = 5;
  constexpr int kMiddle = 1;
  SlopeField slopes(kSize, kSize);
  slopes.valid.fill(1);
  WhitenedPlanes planes(kSize, kSize);
  fill_planes(slopes, Image<float>(kSize, kSize, 1.0F), slopes.valid, 1.0F, planes);
  const NodeFilter filter = filter_at(planes, pattern, kMiddle, kMiddle);
  // A cell's correlation is 1 with itself and −¼ with a cell across a corner.
  const auto covariance = [&](int dr, int dc) {
    double sum = 0.0;
    for (int a = 0; a < 9; ++a) {
      for (int b = 0; b < 9; ++b) {
        const int rows = std::abs(b / 3 + dr - a / 3);
        const int cols = std::abs(b % 3 + dc - a % 3);
        const double part = rows == 0 && cols == 0 ? 1.0 : (rows == 1 && cols == 1 ? -0.25 : 0.0);
        sum += part * static_cast<double>(filter.weights[static_cast<std::size_t>(a)]) *
               static_cast<double>(filter.weights[static_cast<std::size_t>(b)]);
      }
    }
    return sum;
  };
  CellNeighbours neighbours;
  neighbours.orthogonal_correlation = covariance(0, 1) / covariance(0, 0);
  neighbours.diagonal_correlation = covariance(1, 1) / covariance(0, 0);
  return neighbours;
}

struct Odds {
  float offset;  // log odds with the term of the frame's noise
  float per_sigma;
  float per_darkness;
  float per_log_information;

  Odds(const WhitenedOptions& o, float noise_rad2) noexcept
      : per_sigma(static_cast<float>(o.log_odds_per_sigma)),
        per_darkness(static_cast<float>(o.log_odds_per_darkness)),
        per_log_information(static_cast<float>(o.log_odds_per_log_information)) {
    offset = static_cast<float>(o.log_odds) +
             static_cast<float>(o.log_odds_per_log_noise) * quick_log(noise_rad2 + kMinLog) +
             per_log_information * quick_log(static_cast<float>(o.slope_clutter_rad2));
  }
  float of(float z, float darkness, float information) const noexcept {
    return offset + per_sigma * z + per_darkness * darkness +
           per_log_information * quick_log(information);
  }
};

float min_log_odds(const WhitenedOptions& options) noexcept {
  return static_cast<float>(std::log(options.min_probability / (1.0 - options.min_probability)));
}

FirstLook first_look(const WhitenedOptions& options, const Odds& odds) noexcept {
  FirstLook look;
  look.pattern = options.pattern;
  look.offset = (min_log_odds(options) - odds.offset) / odds.per_sigma;
  look.per_darkness = odds.per_darkness / odds.per_sigma;
  look.per_log_information = -odds.per_log_information / odds.per_sigma;
  return look;
}

/// Fills workspace.seen with the nodes that pass both tests.
void sight(const WhitenedPlan& plan, const SlopeField& slopes, const Odds& odds,
           WhitenedWorkspace& workspace) noexcept {
  const WhitenedPlanes& planes = workspace.planes;
  const VortexPattern& pattern = plan.options().pattern;
  const float minimum = min_log_odds(plan.options());
  const float threshold = plan.threshold_sigmas() * plan.threshold_sigmas();
  const float first_threshold = kFirstLookPart * kFirstLookPart * threshold;
  workspace.seen.clear();
  workspace.seen_at.fill(-1);
  for (int r = 0; r < planes.first_t_squared.rows(); ++r) {
    for (int c = 0; c < planes.first_t_squared.cols(); ++c) {
      if (!(planes.first_t_squared(r, c) >= first_threshold) || !is_node(workspace.lit, r, c))
        continue;
      const NodeFilter filter = filter_at(planes, pattern, r, c);
      const float square = filter.sum * filter.sum;
      const float variance = noise_variance(slopes, filter, r, c);
      const bool is_number = square > 0.0F && square <= std::numeric_limits<float>::max();
      if (!is_number || !(square > threshold * variance)) continue;
      const float z = std::sqrt(square / filter.information);
      const float log_odds = odds.of(z, planes.darkness(r, c), filter.information);
      if (!(log_odds >= minimum)) continue;
      workspace.seen_at(r, c) = static_cast<std::int32_t>(workspace.seen.size());
      Sighting sighting;
      sighting.row = r;
      sighting.col = c;
      sighting.charge = filter.sum > 0.0F ? 1 : -1;
      sighting.log_odds = log_odds;
      sighting.z = z;
      sighting.t = significance(filter.sum, variance);
      workspace.seen.push(sighting);
    }
  }
}

/// Calls use(index) for the other sightings up to `reach` nodes from this one.
template <typename Use>
void for_each_near(const WhitenedWorkspace& workspace, const Sighting& sighting, int reach,
                   Use use) noexcept {
  const Image<std::int32_t>& at = workspace.seen_at;
  const int first_row = std::max(sighting.row - reach, 0);
  const int last_row = std::min(sighting.row + reach, at.rows() - 1);
  const int first_col = std::max(sighting.col - reach, 0);
  const int last_col = std::min(sighting.col + reach, at.cols() - 1);
  for (int r = first_row; r <= last_row; ++r) {
    for (int c = first_col; c <= last_col; ++c) {
      if (at(r, c) >= 0 && (r != sighting.row || c != sighting.col)) use(at(r, c));
    }
  }
}

/// Keeps, of sightings of one sign side by side, only the one with the best odds.
void keep_strongest(WhitenedWorkspace& workspace) noexcept {
  FixedList<Sighting>& seen = workspace.seen;
  for (std::size_t i = 0; i < seen.size(); ++i) {
    bool strongest = true;
    for_each_near(workspace, seen[i], 1, [&](std::int32_t other) {
      const Sighting& o = seen[static_cast<std::size_t>(other)];
      const bool earlier = other < static_cast<std::int32_t>(i);
      strongest &= o.charge != seen[i].charge || o.log_odds < seen[i].log_odds ||
                   (o.log_odds == seen[i].log_odds && !earlier);
    });
    seen[i].vortex.charge = strongest ? seen[i].charge : 0;
  }
  std::size_t kept = 0;
  for (std::size_t i = 0; i < seen.size(); ++i) {
    const Sighting sighting = seen[i];
    workspace.seen_at(sighting.row, sighting.col) = -1;
    if (sighting.vortex.charge == 0) continue;
    workspace.seen_at(sighting.row, sighting.col) = static_cast<std::int32_t>(kept);
    seen[kept++] = sighting;
  }
  seen.shorten(kept);
}

struct Offset {
  float x = 0;
  float y = 0;
};

/// Returns the way from the node to the centroid of the 3×3 cells' D of its sign. A slope counts by
/// the part of its variance that is not noise.
Offset centroid_of_circulation(const WhitenedPlanes& planes, float clutter_rad2,
                               const Sighting& sighting) noexcept {
  std::array<std::array<float, 4>, 4> main{};
  std::array<std::array<float, 4>, 4> anti{};
  for (int i = 0; i < 4; ++i) {
    for (int j = 0; j < 4; ++j) {
      const int r = sighting.row + i;
      const int c = sighting.col + j;
      const float part = 0.5F * clutter_rad2 / planes.half_variance(r, c);
      main[static_cast<std::size_t>(i)][static_cast<std::size_t>(j)] = part * planes.main(r, c);
      anti[static_cast<std::size_t>(i)][static_cast<std::size_t>(j)] = part * planes.anti(r, c);
    }
  }
  const auto sign = static_cast<float>(sighting.charge);
  float sum = 0.0F, sum_x = 0.0F, sum_y = 0.0F;
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t j = 0; j < 3; ++j) {
      const float d = (main[i][j] - main[i + 1][j + 1]) + (anti[i][j + 1] - anti[i + 1][j]);
      const float weight = std::max(sign * d, 0.0F);
      sum += weight;
      sum_x += weight * (static_cast<float>(j) - 1.0F);
      sum_y += weight * (static_cast<float>(i) - 1.0F);
    }
  }
  const float scale = sum > 0.0F ? 1.0F / sum : 0.0F;
  return {sum_x * scale, sum_y * scale};
}

/// Returns how much brighter the node's lenslets are on the left than on the right, and above than
/// below.
Offset slope_of_brightness(const WhitenedPlanes& planes, const Sighting& sighting) noexcept {
  std::array<float, 4> brightness{};
  float sum = 0.0F, n = 0.0F;
  for (int k = 0; k < 4; ++k) {
    const int r = sighting.row + 1 + k / 2;
    const int c = sighting.col + 1 + k % 2;
    sum += planes.brightness(r, c);
    n += planes.known(r, c);
  }
  const float mean = sum / std::max(n, 1.0F);
  for (int k = 0; k < 4; ++k) {
    const int r = sighting.row + 1 + k / 2;
    const int c = sighting.col + 1 + k % 2;
    brightness[static_cast<std::size_t>(k)] =
        planes.known(r, c) > 0.0F ? planes.brightness(r, c) : mean;
  }
  return {0.5F * ((brightness[0] + brightness[2]) - (brightness[1] + brightness[3])),
          0.5F * ((brightness[0] + brightness[1]) - (brightness[2] + brightness[3]))};
}

void measure(const WhitenedPlan& plan, const CirculationMap& circulation,
             const WhitenedPlanes& planes, Sighting& sighting) noexcept {
  const WhitenedOptions& options = plan.options();
  const Offset d =
      centroid_of_circulation(planes, static_cast<float>(options.slope_clutter_rad2), sighting);
  const Offset dark = slope_of_brightness(planes, sighting);
  const auto circulation_pull = static_cast<float>(options.circulation_pull);
  const auto darkness_pull = static_cast<float>(options.darkness_pull);
  Vortex& vortex = sighting.vortex;
  vortex.x = static_cast<float>(sighting.col) + 0.5F +
             std::clamp(circulation_pull * d.x + darkness_pull * dark.x, -1.0F, 1.0F);
  vortex.y = static_cast<float>(sighting.row) + 0.5F +
             std::clamp(circulation_pull * d.y + darkness_pull * dark.y, -1.0F, 1.0F);
  vortex.charge = sighting.charge;
  vortex.circulation = planes.circulation(sighting.row + 1, sighting.col + 1);
  vortex.significance = sighting.t;
  vortex.probability = 1.0F / (1.0F + std::exp(-sighting.log_odds));
  vortex.variance_x = vortex.variance_y =
      std::min(static_cast<float>(options.position_variance) +
                   static_cast<float>(options.position_variance_per_z2) /
                       std::max(sighting.z * sighting.z, 0.01F),
               kMaxVariance);
  for (int r = sighting.row - 1; r <= sighting.row + 1; ++r) {
    for (int c = sighting.col - 1; c <= sighting.col + 1; ++c) {
      if (!circulation.valid.contains(r, c) || circulation.valid(r, c) == 0)
        vortex.flags |= plan.flags_when_missing(r, c);
    }
  }
}

/// Marks two opposite sightings as partners if they cannot be told apart and each is the other's
/// nearest.
void pair_up(const WhitenedPlan& plan, WhitenedWorkspace& workspace) noexcept {
  FixedList<Sighting>& seen = workspace.seen;
  const auto sigmas = static_cast<float>(plan.options().pair_sigmas);
  const auto likely = static_cast<float>(plan.options().pair_likely);
  for (std::size_t i = 0; i < seen.size(); ++i) {
    const Vortex& a = seen[i].vortex;
    float nearest = std::numeric_limits<float>::max();
    for_each_near(workspace, seen[i], kPairReach, [&](std::int32_t other) {
      const Vortex& b = seen[static_cast<std::size_t>(other)].vortex;
      const float z = seen[static_cast<std::size_t>(other)].z;
      const bool alike = std::min(z, seen[i].z) >= kAlike * std::max(z, seen[i].z);
      if (a.charge == b.charge || !alike) return;
      if ((a.probability >= likely) != (b.probability >= likely)) return;
      const float x = a.x - b.x;
      const float y = a.y - b.y;
      const float apart = x * x + y * y;
      const float minimum = sigmas * sigmas * (a.variance_x + b.variance_x);
      if (apart < std::min(minimum, kWidestPair * kWidestPair) && apart < nearest) {
        nearest = apart;
        seen[i].partner = other;
      }
    });
  }
  for (std::size_t i = 0; i < seen.size(); ++i) {
    const std::int32_t partner = seen[i].partner;
    if (partner < 0) continue;
    const bool mutual =
        seen[static_cast<std::size_t>(partner)].partner == static_cast<std::int32_t>(i);
    if (!mutual) seen[i].partner = -1;
  }
}

Vortex merge(const Vortex& a, const Vortex& b) noexcept {
  Vortex pair;
  pair.x = 0.5F * (a.x + b.x);
  pair.y = 0.5F * (a.y + b.y);
  pair.circulation = a.circulation + b.circulation;
  pair.significance = std::max(a.significance, b.significance);
  pair.probability = std::min(a.probability, b.probability);
  pair.variance_x = 0.25F * (a.variance_x + b.variance_x);
  pair.variance_y = 0.25F * (a.variance_y + b.variance_y);
  pair.flags = a.flags | b.flags | kVortexUnresolvedPair;
  return pair;
}

}  // namespace

WhitenedPlan::WhitenedPlan(const WhitenedOptions& options, const Image<std::uint8_t>& lenslet_valid,
                           std::size_t capacity)
    : options_(options),
      lenslet_valid_(lenslet_valid),
      cells_({.false_alarms_per_frame = options.false_alarms_per_frame}, lenslet_valid, capacity) {
  check(options);
  CellNeighbours neighbours = correlate(options.pattern);
  double orthogonal = 0.0;
  double diagonal = 0.0;
  for (int r = 0; r + 1 < rows(); ++r) {
    for (int c = 0; c + 1 < cols(); ++c) {
      if (!is_node(lenslet_valid, r, c)) continue;
      ++n_nodes_;
      for (const int dr : {-1, 0, 1}) {
        for (const int dc : {-1, 0, 1}) {
          const bool other = r + dr >= 0 && c + dc >= 0 && r + dr + 1 < rows() &&
                             c + dc + 1 < cols() && is_node(lenslet_valid, r + dr, c + dc);
          if (!other || (dr == 0 && dc == 0)) continue;
          (dr == 0 || dc == 0 ? orthogonal : diagonal) += 1.0;
        }
      }
    }
  }
  const double n = std::max(n_nodes_, 1);
  neighbours.orthogonal = orthogonal / n;
  neighbours.diagonal = diagonal / n;
  threshold_sigmas_ = static_cast<float>(std::min(
      curlew::threshold_sigmas(options.false_alarms_per_frame, n_nodes_, neighbours), 1e15));
}

WhitenedWorkspace::WhitenedWorkspace(const WhitenedPlan& plan)
    : lit(plan.lenslet_valid()),
      planes(plan.rows(), plan.cols()),
      seen(planes.darkness.size()),
      seen_at(plan.rows() - 1, plan.cols() - 1, -1) {}

bool filter_alike(const WhitenedPlan& a, const WhitenedPlan& b) {
  WhitenedOptions options = a.options();
  options.false_alarms_per_frame = b.options().false_alarms_per_frame;
  return options == b.options();
}

void find_whitened_vortices(const WhitenedPlan& plan, const SlopeField& slopes,
                            const Image<float>& flux_adu, const CirculationMap& circulation,
                            WhitenedWorkspace& workspace, VortexList& vortices) noexcept {
  check_size("find_whitened_vortices", "slopes", size_of(slopes), size_of(plan));
  check_size("find_whitened_vortices", "flux", size_of(flux_adu), size_of(plan));
  check_size("find_whitened_vortices", "circulation", size_of(circulation.value),
             {plan.rows() - 1, plan.cols() - 1});
  vortices.clear();
  const WhitenedOptions& options = plan.options();
  WhitenedPlanes& planes = workspace.planes;
  if (!workspace.is_filled) {
    fill_planes(slopes, flux_adu, workspace.lit, static_cast<float>(options.slope_clutter_rad2),
                planes);
    look_over(first_look(options, Odds(options, planes.noise_rad2)), planes);
  }
  const Odds odds(options, planes.noise_rad2);
  sight(plan, slopes, odds, workspace);
  keep_strongest(workspace);
  FixedList<Sighting>& seen = workspace.seen;
  for (Sighting& sighting : seen) measure(plan, circulation, planes, sighting);
  pair_up(plan, workspace);
  for (std::size_t i = 0; i < seen.size(); ++i) {
    const std::int32_t partner = seen[i].partner;
    if (partner < 0) continue;
    Sighting& other = seen[static_cast<std::size_t>(partner)];
    seen[i].vortex = merge(seen[i].vortex, other.vortex);
    seen[i].log_odds = std::min(seen[i].log_odds, other.log_odds);
    other.partner = -1;
    other.charge = 0;  // The pair has taken its place.
  }
  std::sort(seen.begin(), seen.end(), [](const Sighting& a, const Sighting& b) {
    if (a.log_odds != b.log_odds) return a.log_odds > b.log_odds;
    return a.row != b.row ? a.row < b.row : a.col < b.col;
  });
  for (const Sighting& sighting : seen) {
    if (sighting.charge != 0) vortices.push(sighting.vortex);
  }
}

}  // namespace curlew
