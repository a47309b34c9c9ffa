#include "centroiding/sharp_pixels.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <limits>
#include <numbers>
#include <vector>

#include "centroiding/pixel_faults.h"
#include "centroiding/pixel_search.h"
#include "core/as_size.h"
#include "core/size_check.h"
#include "core/team.h"

namespace curlew {
namespace {

bool contains(const CentroidPlan::Spot& spot, int x, int y) noexcept {
  return x >= spot.x0 && x < spot.x0 + spot.w && y >= spot.y0 && y < spot.y0 + spot.h;
}

/// Calls work(lenslet, window) for every window in which the candidate lies. Returns false, and
/// does nothing, if the level of these lenslets is not known yet, or if one of these windows is not
/// in the frame's first `ready` rows.
template <typename Work>
bool for_each_window(const SharpPixelPlan& plan, const CentroidPlan& centroid,
                     const Image<CentroidPlan::Spot>& windows, const FrameLevels& levels,
                     const SharpPixel& candidate, int ready, Work work) noexcept {
  const int rows = windows.rows(), cols = windows.cols();
  int r0 = 0, c0 = 0;
  double moved_x = 0.0, moved_y = 0.0;
  for (int i = 0; i < 2; ++i) {  // Windows may have been moved, and neighbours about alike.
    const auto [col, row] =
        plan.grid.lenslet_from_pixel(candidate.x - moved_x, candidate.y - moved_y);
    r0 = std::clamp(static_cast<int>(std::lround(row)), 0, rows - 1);
    c0 = std::clamp(static_cast<int>(std::lround(col)), 0, cols - 1);
    moved_x = windows(r0, c0).x0 - centroid.spots(r0, c0).x0;
    moved_y = windows(r0, c0).y0 - centroid.spots(r0, c0).y0;
  }
  const int last = std::min(r0 + 1, rows - 1);
  if (last >= levels.rows) return false;
  std::array<std::size_t, 9> found{};
  std::size_t n = 0;
  for (int r = std::max(r0 - 1, 0); r <= last; ++r) {
    for (int c = std::max(c0 - 1, 0); c <= std::min(c0 + 1, cols - 1); ++c) {
      const std::size_t k = as_size(r) * as_size(cols) + as_size(c);
      const CentroidPlan::Spot& spot = windows[k];
      if (spot.state == LensletState::kUnlit || !contains(spot, candidate.x, candidate.y)) continue;
      if (spot.y0 + spot.h > ready) return false;
      found[n++] = k;
    }
  }
  for (std::size_t i = 0; i < n; ++i) work(found[i], windows[found[i]]);
  return true;
}

void mark_broken(SharpPixels& sharp, std::size_t k) noexcept {
  sharp.broken[k] = 1;
  sharp.any_broken = true;
}

/// Marks the lenslets that reach below the last candidate of a full list, where not all pixels were
/// looked at. The list for clumps is another matter: spots that are bright and finely sampled fill
/// it with pixels that are none, and clumps that do not fit are not seen.
void mark_unsearched(const FixedList<SharpPixel>& candidates,
                     const Image<CentroidPlan::Spot>& windows, SharpPixels& sharp) noexcept {
  if (candidates.size() < candidates.capacity()) return;
  const int last = candidates[candidates.size() - 1].y;
  for (std::size_t k = 0; k < windows.size(); ++k) {
    const CentroidPlan::Spot& spot = windows[k];
    if (spot.state != LensletState::kUnlit && spot.y0 + spot.h > last) mark_broken(sharp, k);
  }
}

/// Calls find(begin, end, list) for rows [first, last), and adds what was found to `candidates` in
/// the order of rows, whoever found it.
template <typename Find>
void search_rows(Team* team, int first, int last, std::vector<FixedList<SharpPixel>>& parts,
                 FixedList<SharpPixel>& candidates, const Find& find) noexcept {
  if (team == nullptr) return find(first, last, candidates);
  for (FixedList<SharpPixel>& part : parts) part.clear();
  share_rows(team, first, last,
             [&](int piece, int begin, int end) { find(begin, end, parts[as_size(piece)]); });
  const bool fits = std::all_of(parts.begin(), parts.end(),
                                [](const auto& part) { return part.overflow() == 0; });
  if (!fits) return find(first, last, candidates);
  for (const FixedList<SharpPixel>& part : parts)
    for (const SharpPixel& found : part) candidates.push(found);
}

void forget_lenslets(SharpPixels& sharp) noexcept {
  sharp.pixels.clear();
  sharp.first.fill(-1);
  sharp.broken.fill(0);
  sharp.any_broken = false;
  sharp.assigned = sharp.clumps_assigned = 0;
}

/// Returns the light in the middle pixel of a Gaussian spot, where it is greatest, over that of a
/// pixel `distance` away; NaN if σ is NaN.
double sharpness_of_gaussian(double sigma_px, double distance) noexcept {
  const auto light_within = [&](double px) { return std::erf(px / (std::sqrt(2.0) * sigma_px)); };
  return 2.0 * light_within(0.5) / (light_within(distance + 0.5) - light_within(distance - 0.5));
}

/// Returns the σ of the narrowest spot that the sensor can have, px: that of its references, or of
/// diffraction where references are wider. It is NaN where neither is known.
double narrowest_sigma_px(const Sensor& sensor) noexcept {
  constexpr double kDiffraction = 0.42;  // λ/w
  const double slope_rad_per_px = std::abs(sensor.optics.slope_rad_per_px());
  const double diffraction_px = slope_rad_per_px > 0.0 && std::isfinite(slope_rad_per_px)
                                    ? kDiffraction * 2.0 * std::numbers::pi / slope_rad_per_px
                                    : std::numeric_limits<double>::quiet_NaN();
  return std::fmin(std::fmin(sensor.spot_gaussian_px, sensor.spot_sigma_px), diffraction_px);
}

}  // namespace

SharpPixelPlan::SharpPixelPlan(const Sensor& sensor, const FrameFormat& format)
    : grid(sensor.grid) {
  constexpr double kMargin = 1.4;
  constexpr double kUndersampled = 4.0;  // Sharper spots are as sharp as a cosmic ray.
  const double allowed = kMargin * std::fmax(sensor.spot_sharpness,
                                             sharpness_of_gaussian(sensor.spot_gaussian_px, 1.0));
  sharpness = allowed > 1.0 && allowed <= kUndersampled ? static_cast<float>(allowed) : 0.0F;
  // In strong turbulence a spot falls apart into speckles, of which some are narrower than a spot.
  constexpr double kClumpMargin = 3.0;
  constexpr double kNarrowSpots = 5.0;  // Spots that fall faster are as narrow as clumps.
  const double fall = sharpness_of_gaussian(narrowest_sigma_px(sensor), 2.0);
  clump_sharpness = fall <= kNarrowSpots ? static_cast<float>(kClumpMargin * fall) : 0.0F;
  std::vector<float> darks;
  std::copy_if(sensor.dark_adu.begin(), sensor.dark_adu.end(), std::back_inserter(darks),
               [](float value) { return std::isfinite(value); });
  if (darks.empty()) darks.push_back(static_cast<float>(sensor.background_adu));
  const auto counts_at = [&](std::size_t place) {
    std::nth_element(darks.begin(), darks.begin() + static_cast<std::ptrdiff_t>(place),
                     darks.end());
    return (darks[place] - static_cast<float>(format.zero_adu)) /
           static_cast<float>(format.scale_adu);
  };
  const std::size_t few = darks.size() / 100;  // 1 % are hot pixels, or dead ones
  dark = counts_at(darks.size() - few - 1);
  low_dark = counts_at(few);
}

SharpPixels::SharpPixels(int rows, int cols)
    : pixels(4 * as_size(rows) * as_size(cols) + 64),
      candidates(16 * as_size(rows) * as_size(cols) + 64),
      clump_candidates(pixels.capacity()),
      parts(kTeamPieces, FixedList<SharpPixel>(as_size(rows) * as_size(cols) / 4 + 64)),
      first(rows, cols, -1),
      broken(rows, cols) {}

void begin_sharp_pixels(SharpPixels& sharp) noexcept {
  sharp.candidates.clear();
  sharp.clump_candidates.clear();
  forget_lenslets(sharp);
  sharp.pixel_rows = sharp.clump_rows = 0;
}

int find_sharp_pixels_rows(const SharpPixelPlan& plan, const CentroidPlan& centroid,
                           const Image<CentroidPlan::Spot>& windows, FrameView frame, int ready,
                           const FrameLevels& levels, SharpPixels& sharp, Team* team) noexcept {
  check_size("find_sharp_pixels", "a frame", {frame.rows, frame.cols},
             {centroid.frame_rows, centroid.frame_cols});
  check_size("find_sharp_pixels", "lenslets", size_of(sharp.first), size_of(centroid.spots));
  check_size("find_sharp_pixels", "windows", size_of(windows), size_of(centroid.spots));
  // The rows below each must be there, and those at the frame's rim have too few neighbours.
  const auto search = [&](int reach, int& done, auto& candidates, const auto& find) {
    constexpr std::int64_t kLanes = 32;  // Before the frame is whole, a vector must fit.
    const int first = std::max(done, reach);
    const int last = ready - reach;
    const bool wide = std::int64_t{frame.cols} * (last - reach) >= kLanes;
    if (first >= last || !(wide || ready == frame.rows)) return;
    search_rows(team, first, last, sharp.parts, candidates, find);
    done = last;
  };
  search(1, sharp.pixel_rows, sharp.candidates, [&](int first, int last, auto& found) {
    search_faults(frame, first, last, rough_faults(plan, levels, centroid.counts_per_e), found);
  });
  int looked_at = sharp.pixel_rows;
  if (plan.clump_sharpness > 0.0F) {
    search(2, sharp.clump_rows, sharp.clump_candidates, [&](int first, int last, auto& found) {
      search_clumps(frame, first, last, rough_clumps(plan, levels, centroid.counts_per_e), found);
    });
    looked_at = std::min(looked_at, sharp.clump_rows);
  }
  if (ready == frame.rows) looked_at = ready;
  mark_unsearched(sharp.candidates, windows, sharp);

  const auto look_at_each = [&](const FixedList<SharpPixel>& candidates, std::size_t& assigned,
                                const auto& look) {
    for (; assigned < candidates.size(); ++assigned) {
      const SharpPixel& at = candidates[assigned];
      const bool known =
          for_each_window(plan, centroid, windows, levels, at, ready,
                          [&](std::size_t k, const CentroidPlan::Spot& spot) {
                            look(at, k, PixelFaults(plan, centroid, frame, levels, k, spot));
                          });
      if (known) continue;
      looked_at = std::min(looked_at, at.y);
      return;
    }
  };
  look_at_each(sharp.candidates, sharp.assigned,
               [&](const SharpPixel& at, std::size_t k, const PixelFaults& faults) {
                 const PixelFault fault = faults.at(at.x, at.y);
                 if (fault == PixelFault::kWide) mark_broken(sharp, k);
                 if (fault != PixelFault::kSingle) return;
                 const auto index = static_cast<std::int32_t>(sharp.pixels.size());
                 if (sharp.pixels.push({at.x, at.y, sharp.first[k]}))
                   sharp.first[k] = index;
                 else
                   mark_broken(sharp, k);
               });
  look_at_each(sharp.clump_candidates, sharp.clumps_assigned,
               [&](const SharpPixel& at, std::size_t k, const PixelFaults& faults) {
                 if (faults.is_in_clump(at.x, at.y)) mark_broken(sharp, k);
               });
  return looked_at;
}

void find_sharp_pixels(const SharpPixelPlan& plan, const CentroidPlan& centroid,
                       const Image<CentroidPlan::Spot>& windows, FrameView frame,
                       const FrameLevels& levels, SharpPixels& sharp, Team* team) noexcept {
  begin_sharp_pixels(sharp);
  find_sharp_pixels_rows(plan, centroid, windows, frame, frame.rows, levels, sharp, team);
}

void assign_sharp_pixels(const SharpPixelPlan& plan, const CentroidPlan& centroid,
                         const Image<CentroidPlan::Spot>& windows, FrameView frame,
                         const FrameLevels& levels, SharpPixels& sharp) noexcept {
  forget_lenslets(sharp);
  sharp.pixel_rows = sharp.clump_rows = frame.rows;
  find_sharp_pixels_rows(plan, centroid, windows, frame, frame.rows, levels, sharp);
}

}  // namespace curlew
