#include "detect/circulation_finder.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "core/error.h"
#include "core/size_check.h"

namespace curlew {
namespace {

/// A cell must exceed this threshold.
struct Threshold {
  float sigmas_squared;
  float circulation_rad;

  bool passed_by(float value, float variance) const noexcept {
    return (value * value > sigmas_squared * variance) & (std::abs(value) >= circulation_rad) &
           (std::abs(value) <= std::numeric_limits<float>::max());
  }
};

/// Calls use(dr, dc) for the eight neighbours of a cell.
template <typename Use>
void for_each_neighbour(Use use) noexcept {
  for (int dr = -1; dr <= 1; ++dr) {
    for (int dc = -1; dc <= 1; ++dc) {
      if (dr != 0 || dc != 0) use(dr, dc);
    }
  }
}

/// Returns whether a cell that passed the threshold is the strongest of its sign among its
/// neighbours, and not a lobe of an opposite one.
bool is_vortex(const CirculationMap& map, Threshold threshold, float lobe_fraction, int row,
               int col) noexcept {
  const float value = map.value(row, col);
  bool strongest = true;
  bool lobe = false;
  for_each_neighbour([&](int dr, int dc) {
    const int r = row + dr;
    const int c = col + dc;
    if (!map.value.contains(r, c) || map.valid(r, c) == 0) return;
    const float other = map.value(r, c);
    if ((other > 0.0F) != (value > 0.0F)) {
      lobe |= std::abs(value) < lobe_fraction * std::abs(other);
      return;
    }
    const bool earlier = dr < 0 || (dr == 0 && dc < 0);
    const bool beaten = std::abs(other) > std::abs(value) || (other == value && earlier);
    strongest &= !(beaten && threshold.passed_by(other, map.variance(r, c)));
  });
  return strongest && !lobe;
}

constexpr float kPedestal = 0.05F;  // as a fraction of the peak; see find_circulation_vortices()

Vortex measure(const CirculationPlan& plan, const CirculationMap& map, int row, int col) noexcept {
  const float value = map.value(row, col);
  const float peak = std::abs(value);
  const float sign = value > 0.0F ? 1.0F : -1.0F;
  const auto weight = [&](int r, int c) {
    const float sigma = std::sqrt(std::max(map.variance(r, c), 0.0F));
    return std::max(sign * map.value(r, c) - sigma - kPedestal * peak, 0.0F);
  };

  Vortex vortex;
  vortex.charge = value > 0.0F ? 1 : -1;
  vortex.circulation = value;
  vortex.significance = significance(value, map.variance(row, col));
  float sum = weight(row, col);
  float sum_x = 0.0F;
  float sum_y = 0.0F;
  for_each_neighbour([&](int dr, int dc) {
    const int r = row + dr;
    const int c = col + dc;
    if (!map.value.contains(r, c) || map.valid(r, c) == 0) {
      vortex.flags |= plan.flags_when_missing(r, c);
      return;
    }
    const float w = weight(r, c);
    sum += w;
    sum_x += w * static_cast<float>(dc);
    sum_y += w * static_cast<float>(dr);
  });
  // The sum may be 0 where the threshold is below 1 σ; then the vortex lies at the cell's centre.
  const float scale = sum > 0.0F ? 1.0F / sum : 0.0F;
  vortex.x = static_cast<float>(col) + 0.5F + std::clamp(sum_x * scale, -1.0F, 1.0F);
  vortex.y = static_cast<float>(row) + 0.5F + std::clamp(sum_y * scale, -1.0F, 1.0F);
  return vortex;
}

/// Returns whether any of n cells passes. The loop has no early exit, so that the compiler makes a
/// few vector instructions of it.
bool any_passes(const float* value, const float* variance, int n, Threshold threshold) noexcept {
  int passed = 0;
  for (int c = 0; c < n; ++c) passed |= threshold.passed_by(value[c], variance[c]) ? 1 : 0;
  return passed != 0;
}

enum class Place : std::uint8_t { kInPupil, kInHole, kOutside };

/// Returns where each lenslet place lies, with one ring of surroundings: [rows+2, cols+2]. A place
/// is outside if a way leads to it from the surroundings over sides of lenslets that the sensor
/// lacks. All other places that the sensor lacks are holes.
Image<Place> survey(const Image<std::uint8_t>& lenslet_valid) {
  const int rows = lenslet_valid.rows() + 2;
  const int cols = lenslet_valid.cols() + 2;
  Image<Place> place(rows, cols, Place::kInHole);
  for (int r = 0; r < lenslet_valid.rows(); ++r) {
    for (int c = 0; c < lenslet_valid.cols(); ++c) {
      if (lenslet_valid(r, c) != 0) place(r + 1, c + 1) = Place::kInPupil;
    }
  }
  struct Spot {
    int row, col;
  };
  std::vector<Spot> to_visit{{0, 0}};
  place(0, 0) = Place::kOutside;
  while (!to_visit.empty()) {
    const Spot at = to_visit.back();
    to_visit.pop_back();
    for (const Spot step : {Spot{-1, 0}, Spot{1, 0}, Spot{0, -1}, Spot{0, 1}}) {
      const Spot next{at.row + step.row, at.col + step.col};
      if (!place.contains(next.row, next.col)) continue;
      if (place(next.row, next.col) != Place::kInHole) continue;
      place(next.row, next.col) = Place::kOutside;
      to_visit.push_back(next);
    }
  }
  return place;
}

/// Returns flags_when_missing for every cell and for the ring of surroundings: [cell rows+2, cell
/// cols+2].
Image<std::uint8_t> survey_cells(const Image<Place>& place) {
  Image<std::uint8_t> missing(place.rows() - 1, place.cols() - 1);
  for (int r = 0; r < missing.rows(); ++r) {
    for (int c = 0; c < missing.cols(); ++c) {
      std::uint8_t flags = 0;
      for (const Place p : {place(r, c), place(r, c + 1), place(r + 1, c), place(r + 1, c + 1)}) {
        if (p == Place::kOutside) flags |= kVortexAtPupilEdge;
        if (p == Place::kInHole) flags |= kVortexAtHole;
      }
      // A cell that the sensor has can only be lost to a lenslet that faded in the frame.
      missing(r, c) = flags == 0 ? std::uint8_t{kVortexAtHole} : flags;
    }
  }
  return missing;
}

void check(const CirculationOptions& options, const Image<std::uint8_t>& lenslet_valid) {
  if (!(options.false_alarms_per_frame > 0.0) || !std::isfinite(options.false_alarms_per_frame)) {
    throw UsageError("false alarms per frame are " +
                     std::to_string(options.false_alarms_per_frame) +
                     ", which no threshold can give; ask for a number above 0, such as 0.01");
  }
  if (!(options.min_circulation_rad > 0.0)) {
    throw UsageError("the least circulation is " + std::to_string(options.min_circulation_rad) +
                     " rad; give a number above 0, such as 0.1");
  }
  if (!(options.lobe_fraction >= 0.0 && options.lobe_fraction < 1.0)) {
    throw UsageError("the lobe fraction is " + std::to_string(options.lobe_fraction) +
                     "; give a number from 0 to below 1, such as 0.15");
  }
  if (lenslet_valid.rows() < 2 || lenslet_valid.cols() < 2) {
    throw Failure("the sensor has " + std::to_string(lenslet_valid.rows()) + "x" +
                  std::to_string(lenslet_valid.cols()) +
                  " lenslets, but a vortex shows between four; use one of 2x2 or more");
  }
}

bool has_cell(const Image<std::uint8_t>& lenslet_valid, int r, int c) {
  if (r < 0 || c < 0 || r + 1 >= lenslet_valid.rows() || c + 1 >= lenslet_valid.cols())
    return false;
  return lenslet_valid(r, c) != 0 && lenslet_valid(r, c + 1) != 0 && lenslet_valid(r + 1, c) != 0 &&
         lenslet_valid(r + 1, c + 1) != 0;
}

/// Returns the thresholds for 0 to n_max valid cells. The threshold z is smooth in ln n:
/// interpolated linearly between knots 5 % apart it is right to 1e-4.
std::vector<float> tabulate_thresholds(double rate, int n_max, CellNeighbours neighbours) {
  std::vector<float> table{std::numeric_limits<float>::max()};
  table.reserve(static_cast<std::size_t>(n_max) + 1);
  int knot = 0;
  double z = 0.0;
  while (knot < n_max) {
    const int next = std::min(n_max, std::max(knot + 1, static_cast<int>(1.05 * knot)));
    const double z_next = threshold_sigmas(rate, next, neighbours);
    for (int n = knot + 1; n <= next; ++n) {
      const double part = knot == 0 ? 1.0 : std::log(1.0 * n / knot) / std::log(1.0 * next / knot);
      table.push_back(static_cast<float>(z + part * (z_next - z)));
    }
    knot = next;
    z = z_next;
  }
  return table;
}

}  // namespace

CirculationPlan::CirculationPlan(const CirculationOptions& options,
                                 const Image<std::uint8_t>& lenslet_valid, std::size_t capacity)
    : options_(options),
      capacity_(capacity),
      cell_rows_(lenslet_valid.rows() - 1),
      cell_cols_(lenslet_valid.cols() - 1) {
  check(options, lenslet_valid);
  missing_ = survey_cells(survey(lenslet_valid));
  double orthogonal = 0.0;
  double diagonal = 0.0;
  for (int r = 0; r < cell_rows_; ++r) {
    for (int c = 0; c < cell_cols_; ++c) {
      if (!has_cell(lenslet_valid, r, c)) continue;
      ++n_cells_;
      for_each_neighbour([&](int dr, int dc) {
        if (!has_cell(lenslet_valid, r + dr, c + dc)) return;
        (dr == 0 || dc == 0 ? orthogonal : diagonal) += 1.0;
      });
    }
  }
  const double n = std::max(n_cells_, 1);
  threshold_ = tabulate_thresholds(options.false_alarms_per_frame, cell_rows_ * cell_cols_,
                                   {orthogonal / n, diagonal / n});
}

void find_circulation_vortices(const CirculationPlan& plan, const CirculationMap& map,
                               VortexList& vortices) noexcept {
  check_size("find_circulation_vortices", "circulation", size_of(map.value),
             {plan.cell_rows(), plan.cell_cols()});
  vortices.clear();
  const float z = std::min(plan.threshold_sigmas(map.n_valid), 1e18F);  // This keeps z² finite.
  const Threshold threshold{z * z, static_cast<float>(plan.options().min_circulation_rad)};
  const auto lobe_fraction = static_cast<float>(plan.options().lobe_fraction);
  constexpr int kChunk = 32;
  for (int r = 0; r < map.value.rows(); ++r) {
    for (int first = 0; first < map.value.cols(); first += kChunk) {
      const int n = std::min(kChunk, map.value.cols() - first);
      if (!any_passes(&map.value(r, first), &map.variance(r, first), n, threshold)) continue;
      for (int c = first; c < first + n; ++c) {
        if (!threshold.passed_by(map.value(r, c), map.variance(r, c))) continue;
        if (is_vortex(map, threshold, lobe_fraction, r, c)) vortices.push(measure(plan, map, r, c));
      }
    }
  }
}

}  // namespace curlew
