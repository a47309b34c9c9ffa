// Highway compiles this file once for every instruction set and chooses one at run time.
#include "reconstruct/split_rows.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "reconstruct/split_rows.cpp"
#include "hwy/foreach_target.h"
// Highway needs foreach_target.h before the header below.

#include <algorithm>
#include <cstring>

#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace curlew::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::CappedTag<float, 16>;
using V = hn::Vec<D>;
constexpr D d;

/// Weights are kept within this factor of their mean, so that products of them stay finite.
constexpr float kWeightRange = 1e9F;

/// These are the columns [col, col + n) of a lenslet map, which one vector takes. n is less than
/// the vector has lanes at the end of a row.
struct Part {
  std::size_t k;
  std::size_t n;
};

HWY_INLINE V load(const float* map, Part part) {
  if (part.n == hn::Lanes(d)) return hn::LoadU(d, map + part.k);
  HWY_ALIGN float rest[hn::MaxLanes(d)] = {};
  std::memcpy(rest, map + part.k, std::min(part.n * sizeof(float), sizeof rest));
  return hn::Load(d, rest);
}

HWY_INLINE V load(const std::uint8_t* map, Part part) {
  const hn::Rebind<std::uint8_t, D> narrow;
  const hn::Rebind<std::int32_t, D> wide;
  HWY_ALIGN std::uint8_t rest[hn::MaxLanes(d)] = {};
  if (part.n == hn::Lanes(d))
    return hn::ConvertTo(d, hn::PromoteTo(wide, hn::LoadU(narrow, map + part.k)));
  std::memcpy(rest, map + part.k, std::min(part.n, sizeof rest));
  return hn::ConvertTo(d, hn::PromoteTo(wide, hn::Load(narrow, rest)));
}

HWY_INLINE void store(V values, float* map, Part part) {
  if (part.n == hn::Lanes(d)) return hn::StoreU(values, d, map + part.k);
  HWY_ALIGN float rest[hn::MaxLanes(d)];
  hn::Store(values, d, rest);
  std::memcpy(map + part.k, rest, std::min(part.n * sizeof(float), sizeof rest));
}

/// Calls use(part of the lenslet maps, place in the working arrays, row, column) for all lenslets.
template <typename Use>
HWY_INLINE void for_each_part(const SplitGrid& grid, Use use) {
  const std::size_t lanes = hn::Lanes(d);
  const std::size_t cols = as_size(grid.cols);
  for (int row = 0; row < grid.rows; ++row)
    for (std::size_t col = 0; col < cols; col += lanes)
      use(Part{as_size(row) * cols + col, std::min(lanes, cols - col)},
          grid.at(row, static_cast<int>(col)), row, col);
}

/// Calls use(place) for all corners.
template <typename Use>
HWY_INLINE void for_each_corner(const SplitGrid& grid, std::size_t lanes, Use use) {
  for (int row = 0; row <= grid.rows; ++row)
    for (int col = 0; col <= grid.cols; col += static_cast<int>(lanes)) use(grid.at(row, col));
}

HWY_INLINE float sum_of(V values) { return hn::GetLane(hn::SumOfLanes(d, values)); }
HWY_INLINE float largest_of(V values) { return hn::GetLane(hn::MaxOfLanes(d, values)); }

FitSums weigh(const SplitGrid& grid, const float* lit, const SlopeField& slopes, bool by_variance,
              float* weight) {
  const V zero = hn::Zero(d);
  V n = zero, x = zero, y = zero, weights = zero, unknown = zero;
  for_each_part(grid, [&](Part part, std::size_t at, int, std::size_t) HWY_ATTR {
    const V lit_here = hn::LoadU(d, lit + at);
    const auto in_fit =
        hn::And(hn::Gt(load(slopes.valid.data(), part), zero), hn::Gt(lit_here, zero));
    V w = hn::IfThenElseZero(in_fit, lit_here);
    n = hn::Add(n, w);
    x = hn::Add(x, hn::IfThenElseZero(in_fit, load(slopes.x.data(), part)));
    y = hn::Add(y, hn::IfThenElseZero(in_fit, load(slopes.y.data(), part)));
    if (by_variance) {
      const V variance = hn::Mul(hn::Set(d, 0.5F), hn::Add(load(slopes.variance_x.data(), part),
                                                           load(slopes.variance_y.data(), part)));
      const auto known = hn::And(hn::Gt(variance, zero), hn::Lt(variance, hn::Set(d, 3e38F)));
      const V safe = hn::Clamp(hn::IfThenElse(hn::And(in_fit, known), variance, hn::Set(d, 1.0F)),
                               hn::Set(d, 1e-30F), hn::Set(d, 1e30F));
      unknown = hn::Add(unknown, hn::IfThenElse(known, zero, w));
      w = hn::Div(w, safe);
      weights = hn::Add(weights, w);
    }
    hn::StoreU(w, d, weight + at);
  });
  FitSums sums;
  const float count = sum_of(n);
  sums.n = static_cast<int>(count);
  sums.mean_x = sum_of(x) / std::max(count, 1.0F);
  sums.mean_y = sum_of(y) / std::max(count, 1.0F);
  sums.weight = by_variance ? sum_of(weights) : count;
  sums.noise_is_known = sum_of(unknown) == 0.0F;
  return sums;
}

float load_all_edges(const SplitGrid& grid, const SlopeField& slopes, const FitSums& sums,
                     float scale, float* weight, float* edge_a, float* edge_b) {
  const V mean_x = hn::Set(d, sums.mean_x);
  const V mean_y = hn::Set(d, sums.mean_y);
  V largest = hn::Zero(d);
  for_each_part(grid, [&](Part part, std::size_t at, int, std::size_t) HWY_ATTR {
    const V w = hn::LoadU(d, weight + at);
    const auto in_fit = hn::Gt(w, hn::Zero(d));
    const V x = hn::IfThenElseZero(in_fit, hn::Sub(load(slopes.x.data(), part), mean_x));
    const V y = hn::IfThenElseZero(in_fit, hn::Sub(load(slopes.y.data(), part), mean_y));
    const V a = hn::Add(x, y);
    const V b = hn::Sub(y, x);
    largest = hn::Max(largest, hn::Max(hn::Abs(a), hn::Abs(b)));
    hn::StoreU(a, d, edge_a + at);
    hn::StoreU(b, d, edge_b + at);
    if (scale != 1.0F) {
      const V scaled = hn::Clamp(hn::Mul(w, hn::Set(d, scale)), hn::Set(d, 1.0F / kWeightRange),
                                 hn::Set(d, kWeightRange));
      hn::StoreU(hn::IfThenElseZero(in_fit, scaled), d, weight + at);
    }
  });
  return largest_of(largest);
}

void divergence_of(const SplitGrid& grid, const float* a, const float* b, float* divergence) {
  const std::size_t down = grid.stride;
  for_each_corner(grid, hn::Lanes(d), [&](std::size_t at) HWY_ATTR {
    const V along_a = hn::Sub(hn::LoadU(d, a + at - down - 1), hn::LoadU(d, a + at));
    const V along_b = hn::Sub(hn::LoadU(d, b + at - down), hn::LoadU(d, b + at - 1));
    hn::StoreU(hn::Add(along_a, along_b), d, divergence + at);
  });
}

void residual_of(const SplitGrid& grid, const float* weight, const float* edge_a,
                 const float* edge_b, const double* phi, float* residual) {
  const hn::CappedTag<double, 8> wide;
  const hn::Rebind<float, decltype(wide)> narrow;
  const std::size_t down = grid.stride;
  const auto load_wide = [&](const float* p)
                             HWY_ATTR { return hn::PromoteTo(wide, hn::LoadU(narrow, p)); };
  for_each_corner(grid, hn::Lanes(wide), [&](std::size_t at) HWY_ATTR {
    const auto here = hn::LoadU(wide, phi + at);
    // This is w·(e − Γφ) of an edge that ends here, and what its start gets is the opposite of it.
    const auto missing = [&](const float* edge, std::size_t lenslet, auto from, auto to) HWY_ATTR {
      return hn::Mul(load_wide(weight + lenslet),
                     hn::Sub(load_wide(edge + lenslet), hn::Sub(to, from)));
    };
    const auto ends_a = missing(edge_a, at - down - 1, hn::LoadU(wide, phi + at - down - 1), here);
    const auto starts_a = missing(edge_a, at, here, hn::LoadU(wide, phi + at + down + 1));
    const auto ends_b = missing(edge_b, at - down, hn::LoadU(wide, phi + at - down + 1), here);
    const auto starts_b = missing(edge_b, at - 1, here, hn::LoadU(wide, phi + at + down - 1));
    const auto sum = hn::Add(hn::Sub(ends_a, starts_a), hn::Sub(ends_b, starts_b));
    hn::StoreU(hn::DemoteTo(narrow, sum), narrow, residual + at);
  });
}

float add_step_to(const SplitGrid& grid, const float* weight, const float* step, double* phi) {
  const hn::CappedTag<double, 8> wide;
  const hn::Rebind<float, decltype(wide)> narrow;
  using Narrow = hn::Vec<decltype(narrow)>;
  const std::size_t down = grid.stride;
  Narrow largest = hn::Zero(narrow);
  for_each_corner(grid, hn::Lanes(wide), [&](std::size_t at) HWY_ATTR {
    const Narrow here = hn::LoadU(narrow, step + at);
    hn::StoreU(hn::Add(hn::LoadU(wide, phi + at), hn::PromoteTo(wide, here)), wide, phi + at);
    const Narrow a = hn::Sub(hn::LoadU(narrow, step + at + down + 1), here);
    const Narrow b = hn::Sub(hn::LoadU(narrow, step + at + down), hn::LoadU(narrow, step + at + 1));
    const auto in_fit = hn::Gt(hn::LoadU(narrow, weight + at), hn::Zero(narrow));
    const Narrow change = hn::Max(hn::Abs(a), hn::Abs(b));
    largest = hn::Max(largest, hn::IfThenElseZero(in_fit, change));
  });
  return hn::GetLane(hn::MaxOfLanes(narrow, largest));
}

float store_all_slopes(const SplitGrid& grid, const SlopeField& slopes, const FitSums& sums,
                       const float* weight, const float* phi, float* edge_a, float* edge_b,
                       HodgeSplit& split) {
  const std::size_t down = grid.stride;
  const V half = hn::Set(d, 0.5F);
  const V mean_x = hn::Set(d, sums.mean_x);
  const V mean_y = hn::Set(d, sums.mean_y);
  V sum = hn::Zero(d);
  for_each_part(grid, [&](Part part, std::size_t at, int row, std::size_t col) HWY_ATTR {
    const V w = hn::LoadU(d, weight + at);
    const auto in_fit = hn::Gt(w, hn::Zero(d));
    const V phi00 = hn::LoadU(d, phi + at);
    const V phi01 = hn::LoadU(d, phi + at + 1);
    const V phi10 = hn::LoadU(d, phi + at + down);
    const V phi11 = hn::LoadU(d, phi + at + down + 1);
    const V a = hn::Sub(phi11, phi00);
    const V b = hn::Sub(phi10, phi01);
    const V x = hn::Mul(half, hn::Sub(a, b));
    const V y = hn::Mul(half, hn::Add(a, b));
    const V rest_x = hn::Sub(hn::Sub(load(slopes.x.data(), part), mean_x), x);
    const V rest_y = hn::Sub(hn::Sub(load(slopes.y.data(), part), mean_y), y);
    store(hn::IfThenElseZero(in_fit, hn::Add(mean_x, x)), split.curl_free_x.data(), part);
    store(hn::IfThenElseZero(in_fit, hn::Add(mean_y, y)), split.curl_free_y.data(), part);
    store(hn::IfThenElseZero(in_fit, rest_x), split.solenoidal_x.data(), part);
    store(hn::IfThenElseZero(in_fit, rest_y), split.solenoidal_y.data(), part);
    hn::StoreU(hn::IfThenElseZero(in_fit, hn::Mul(w, hn::Add(rest_x, rest_y))), d, edge_a + at);
    hn::StoreU(hn::IfThenElseZero(in_fit, hn::Mul(w, hn::Sub(rest_y, rest_x))), d, edge_b + at);
    const V plane = hn::MulAdd(mean_x, hn::Iota(d, static_cast<float>(col)),
                               hn::Set(d, sums.mean_y * static_cast<float>(row)));
    const V corners = hn::Add(hn::Add(phi00, phi01), hn::Add(phi10, phi11));
    const V phase = hn::IfThenElseZero(in_fit, hn::MulAdd(hn::Set(d, 0.25F), corners, plane));
    store(phase, split.phase.data(), part);
    sum = hn::Add(sum, phase);
  });
  return sum_of(sum);
}

void subtract_from_phase(const SplitGrid& grid, const float* weight, float mean,
                         HodgeSplit& split) {
  const V taken = hn::Set(d, mean);
  for_each_part(grid, [&](Part part, std::size_t at, int, std::size_t) HWY_ATTR {
    const auto in_fit = hn::Gt(hn::LoadU(d, weight + at), hn::Zero(d));
    const V phase = hn::Sub(load(split.phase.data(), part), taken);
    store(hn::IfThenElseZero(in_fit, phase), split.phase.data(), part);
  });
}

void potential_row(const SplitGrid& grid, int row, const float* from_left, const float* from_right,
                   const float* edge_a, const float* edge_b, float* psi) {
  const std::size_t down = grid.stride;
  for (int col = 0; col <= grid.cols; col += static_cast<int>(hn::Lanes(d))) {
    const std::size_t at = grid.at(row, col);
    const V left = hn::Add(hn::LoadU(d, psi + at - down - 1), hn::LoadU(d, edge_b + at - down - 1));
    const V right = hn::Sub(hn::LoadU(d, psi + at - down + 1), hn::LoadU(d, edge_a + at - down));
    hn::StoreU(hn::MulAdd(hn::LoadU(d, from_left + at), left,
                          hn::Mul(hn::LoadU(d, from_right + at), right)),
               d, psi + at);
  }
}

}  // namespace
}  // namespace curlew::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace curlew {

HWY_EXPORT(weigh);
HWY_EXPORT(load_all_edges);
HWY_EXPORT(divergence_of);
HWY_EXPORT(residual_of);
HWY_EXPORT(add_step_to);
HWY_EXPORT(store_all_slopes);
HWY_EXPORT(subtract_from_phase);
HWY_EXPORT(potential_row);

FitSums weigh_lenslets(const SplitGrid& grid, const float* lit, const SlopeField& slopes,
                       bool by_variance, float* weight) noexcept {
  return HWY_DYNAMIC_DISPATCH(weigh)(grid, lit, slopes, by_variance, weight);
}

float load_edges(const SplitGrid& grid, const SlopeField& slopes, const FitSums& sums, float scale,
                 float* weight, float* edge_a, float* edge_b) noexcept {
  return HWY_DYNAMIC_DISPATCH(load_all_edges)(grid, slopes, sums, scale, weight, edge_a, edge_b);
}

void find_divergence(const SplitGrid& grid, const float* edge_a, const float* edge_b,
                     float* divergence) noexcept {
  HWY_DYNAMIC_DISPATCH(divergence_of)(grid, edge_a, edge_b, divergence);
}

void find_residual(const SplitGrid& grid, const float* weight, const float* edge_a,
                   const float* edge_b, const double* phi, float* residual) noexcept {
  HWY_DYNAMIC_DISPATCH(residual_of)(grid, weight, edge_a, edge_b, phi, residual);
}

float add_step(const SplitGrid& grid, const float* weight, const float* step,
               double* phi) noexcept {
  return HWY_DYNAMIC_DISPATCH(add_step_to)(grid, weight, step, phi);
}

float store_slopes(const SplitGrid& grid, const SlopeField& slopes, const FitSums& sums,
                   const float* weight, const float* phi, float* edge_a, float* edge_b,
                   HodgeSplit& split) noexcept {
  return HWY_DYNAMIC_DISPATCH(store_all_slopes)(grid, slopes, sums, weight, phi, edge_a, edge_b,
                                                split);
}

void subtract_mean(const SplitGrid& grid, const float* weight, float mean,
                   HodgeSplit& split) noexcept {
  HWY_DYNAMIC_DISPATCH(subtract_from_phase)(grid, weight, mean, split);
}

void find_potential_row(const SplitGrid& grid, int row, const float* from_left,
                        const float* from_right, const float* edge_a, const float* edge_b,
                        float* psi) noexcept {
  HWY_DYNAMIC_DISPATCH(potential_row)(grid, row, from_left, from_right, edge_a, edge_b, psi);
}

}  // namespace curlew
#endif  // HWY_ONCE
