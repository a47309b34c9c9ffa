// The loops are plain, each over few arrays and without a branch, so that the compiler makes
// vectors of them. Highway has them compiled for every instruction set.
#include "centroiding/spot_marks.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "core/centroids.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "centroiding/spot_marks.cpp"
#include "hwy/foreach_target.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace curlew::HWY_NAMESPACE {
namespace {

// What is known of a spot before its state is looked at.
constexpr int kIsFar = 1, kIsNear = 2, kIsShaped = 4, kHasLight = 8, kIsNotDim = 16;
// A spot's flux over its reference's, where the typical lenslet's is 1: more is glare.
constexpr float kBrightest = 10.0F;

constexpr auto kValidByte = static_cast<std::uint8_t>(LensletState::kValid);
constexpr auto kFaintByte = static_cast<std::uint8_t>(LensletState::kFaint);
constexpr auto kAtEdgeByte = static_cast<std::uint8_t>(LensletState::kAtEdge);
constexpr auto kSaturatedByte = static_cast<std::uint8_t>(LensletState::kSaturated);

void mark_places(const SpotRow& row, const LowOrders::Row& model, const SpotLimits& limits,
                 std::uint8_t* HWY_RESTRICT marks) {
  const RowAxis x = row.x, y = row.y;
  const float* u = row.column_u;
  const float x0 = model.x[0], x1 = model.x[1], x2 = model.x[2];
  const float y0 = model.y[0], y1 = model.y[1], y2 = model.y[2];
  const float far_px2 = limits.far_px2, near_px2 = limits.near_px2;
  const std::size_t n = row.n;
  for (std::size_t c = 0; c < n; ++c) {
    const float off_x =
        x.measured[c] - x.reference[c] - x.place[c] - (x0 + u[c] * (x1 + u[c] * x2));
    const float off_y =
        y.measured[c] - y.reference[c] - y.place[c] - (y0 + u[c] * (y1 + u[c] * y2));
    const float square = off_x * off_x + off_y * off_y;
    marks[c] = static_cast<std::uint8_t>((square > far_px2 ? kIsFar : 0) |
                                         (square < near_px2 ? kIsNear : 0));
  }
}

void mark_shapes(const SpotRow& row, float typical, std::uint8_t* HWY_RESTRICT marks) {
  const float* flux = row.flux;
  const float* reference = row.reference_flux;
  const float* xx = row.xx;
  const float* yy = row.yy;
  const float* widest = row.widest;
  const std::size_t n = row.n;
  for (std::size_t c = 0; c < n; ++c) {
    const float expected = typical * reference[c];
    const int not_dim = flux[c] > kDimmest * expected ? kIsNotDim | kIsShaped : 0;
    const int shaped = (xx[c] + yy[c] < widest[c] ? kIsShaped : 0) &
                       (flux[c] < kBrightest * expected ? kIsShaped : 0) & not_dim;
    marks[c] = static_cast<std::uint8_t>(marks[c] | shaped | (not_dim & kIsNotDim) |
                                         (flux[c] > 0.0F ? kHasLight : 0));
  }
}

/// Turns what is known into what the window holds. Returns how many lenslets have faint light that
/// is not dim.
int settle_marks(const SpotRow& row, const SpotLimits& limits, std::uint8_t* HWY_RESTRICT marks) {
  const std::uint8_t* state = row.states;
  const int anywhere = limits.weak_may_be ? 1 : 0;
  const int counts = limits.faint_count ? 1 : 0;
  int n_faint = 0;
  const std::size_t n = row.n;
  for (std::size_t c = 0; c < n; ++c) {
    const int mark = marks[c];
    const int valid = state[c] == kValidByte ? 1 : 0;
    const int faint = (state[c] == kFaintByte ? 1 : 0) & ((mark & kHasLight) != 0 ? 1 : 0);
    const int weak = (state[c] == kAtEdgeByte ? 1 : 0) | faint;
    const int far = ((mark & kIsFar) != 0 ? 1 : 0) & (1 ^ (weak & anywhere)) & (valid | weak);
    const int near = valid & (1 ^ far);
    const int well = near & ((mark & kIsNear) != 0 ? 1 : 0) & ((mark & kIsShaped) != 0 ? 1 : 0);
    const int seen = faint & ((mark & kIsNotDim) != 0 ? 1 : 0);
    const int faint_spot = seen & counts & (1 ^ far);
    n_faint += seen;
    marks[c] = static_cast<std::uint8_t>(kFarOff * far + kNearModel * near + well +
                                         kFaintSpot * faint_spot);
  }
  return n_faint;
}

int is_spot(std::uint8_t mark) {
  return (mark == kNearModel ? 1 : 0) | (mark == kWellFormed ? 1 : 0) |
         (mark == kFaintSpot ? 1 : 0);
}

/// Returns the bits of the largest displacement, which are in the order of the floats.
std::int32_t largest_of(const SpotRow& row, const LowOrders::Row& model,
                        const std::uint8_t* marks) {
  const float* u = row.column_u;
  const float x0 = model.x[0], x1 = model.x[1], x2 = model.x[2];
  const float y0 = model.y[0], y1 = model.y[1], y2 = model.y[2];
  std::int32_t largest = 0;
  for (std::size_t c = 0; c < row.n; ++c) {
    const float at_x = x0 + u[c] * (x1 + u[c] * x2);
    const float at_y = y0 + u[c] * (y1 + u[c] * y2);
    const std::int32_t size = std::max(std::bit_cast<std::int32_t>(std::abs(at_x)),
                                       std::bit_cast<std::int32_t>(std::abs(at_y)));
    largest = std::max(largest, size & -is_spot(marks[c]));
  }
  return largest;
}

void mark(const SpotRow& row, const LowOrders::Row& model, const SpotLimits& limits,
          std::uint8_t* marks, SpotCounts& counts) {
  mark_places(row, model, limits, marks);
  mark_shapes(row, limits.typical, marks);
  counts.faint += settle_marks(row, limits, marks);
  counts.largest_bits = std::max(counts.largest_bits, largest_of(row, model, marks));
  int spots = 0, light = 0, same = 0, were_lit = 0;
  for (std::size_t c = 0; c < row.n; ++c) {
    const std::uint8_t state = row.states[c];
    const int faint_spot = marks[c] == kFaintSpot ? 1 : 0;
    spots += (marks[c] == kWellFormed ? 1 : 0) | faint_spot;
    same += is_spot(marks[c]) & row.lit[c];
    were_lit += row.lit[c];
    light += (state == kValidByte ? 1 : 0) | (state == kAtEdgeByte ? 1 : 0) |
             (state == kSaturatedByte ? 1 : 0) | faint_spot;
  }
  counts.spots += spots;
  counts.light += light;
  counts.same += same;
  counts.were_lit += were_lit;
}

}  // namespace
}  // namespace curlew::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace curlew {
namespace {

HWY_EXPORT(mark);

}  // namespace

void mark_spots(const SpotRow& row, const LowOrders::Row& model, const SpotLimits& limits,
                std::uint8_t* marks, SpotCounts& counts) noexcept {
  HWY_DYNAMIC_DISPATCH(mark)(row, model, limits, marks, counts);
}

}  // namespace curlew
#endif  // HWY_ONCE
