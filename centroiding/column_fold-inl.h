// This file folds the sums of a strip's columns into the moments of its windows, a vector of
// lenslets at a time: each lane is one lenslet.
//
// Highway compiles it anew for every instruction set, which is why the include guard toggles.
#if defined(CURLEW_COLUMN_FOLD_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef CURLEW_COLUMN_FOLD_INL_H_
#undef CURLEW_COLUMN_FOLD_INL_H_
#else
#define CURLEW_COLUMN_FOLD_INL_H_
#endif

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "centroiding/row_pass-inl.h"
#include "centroiding/spot_finish-inl.h"
#include "core/as_size.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace curlew::HWY_NAMESPACE {

/// Says where in the lines the windows of some lenslets begin, and how wide they are.
struct FoldedWindows {
  const std::int32_t* begin;  ///< [lanes]
  FloatVec half_width;        ///< (w − 1)/2
  int min_width;
  int max_width;
};

#if HWY_TARGET == HWY_SCALAR
inline void load_columns(const float* line, const std::int32_t* begin, FloatVec* column) {
  const FloatTag d;
  for (int j = 0; j < 4; ++j) column[j] = hn::LoadU(d, line + *begin + j);
}
#else
/// Loads four values from each of four places for every 16 bytes of a vector. Block b has those of
/// begin[4b].
template <class D>
hn::Vec<D> load_blocks(D d, const float* line, const std::int32_t* begin) {
  if constexpr (hn::MaxLanes(D()) > 4) {
    const hn::Half<D> half;
    return hn::Combine(d, load_blocks(half, line, begin + hn::Lanes(half)),
                       load_blocks(half, line, begin));
  } else {
    return hn::LoadU(d, line + *begin);
  }
}

/// Loads four columns: lane i of column[j] is value begin[i] + j of the line.
inline void load_columns(const float* line, const std::int32_t* begin, FloatVec* column) {
  const FloatTag d;
  const hn::Repartition<std::uint64_t, FloatTag> pairs;
  const FloatVec a = load_blocks(d, line, begin), b = load_blocks(d, line, begin + 1),
                 c = load_blocks(d, line, begin + 2), e = load_blocks(d, line, begin + 3);
  const auto ab_low = hn::BitCast(pairs, hn::InterleaveLower(d, a, b));
  const auto ce_low = hn::BitCast(pairs, hn::InterleaveLower(d, c, e));
  const auto ab_high = hn::BitCast(pairs, hn::InterleaveUpper(d, a, b));
  const auto ce_high = hn::BitCast(pairs, hn::InterleaveUpper(d, c, e));
  column[0] = hn::BitCast(d, hn::InterleaveLower(pairs, ab_low, ce_low));
  column[1] = hn::BitCast(d, hn::InterleaveUpper(pairs, ab_low, ce_low));
  column[2] = hn::BitCast(d, hn::InterleaveLower(pairs, ab_high, ce_high));
  column[3] = hn::BitCast(d, hn::InterleaveUpper(pairs, ab_high, ce_high));
}
#endif

/// Folds the sums of columns s, s_y and s_yy. y counts from the strip's middle.
inline Moments<FloatTag> fold_columns(const FoldedWindows& windows, const StripLine<float>& s,
                                      const StripLine<float>& s_y, const StripLine<float>& s_yy) {
  const FloatTag d;
  const FloatVec zero = hn::Zero(d);
  Moments<FloatTag> m{zero, zero, zero, zero, zero, zero};
  for (int first = 0; first < windows.max_width; first += 4) {
    FloatVec a[4], b[4], c[4];
    load_columns(s.data() + first, windows.begin, a);
    load_columns(s_y.data() + first, windows.begin, b);
    load_columns(s_yy.data() + first, windows.begin, c);
    for (int i = 0; i < std::min(4, windows.max_width - first); ++i) {
      const FloatVec x = hn::Sub(hn::Set(d, static_cast<float>(first + i)), windows.half_width);
      if (first + i >= windows.min_width) {
        const auto inside = hn::Le(x, windows.half_width);
        a[i] = hn::IfThenElseZero(inside, a[i]);
        b[i] = hn::IfThenElseZero(inside, b[i]);
        c[i] = hn::IfThenElseZero(inside, c[i]);
      }
      const FloatVec ax = hn::Mul(a[i], x);
      m.s = hn::Add(m.s, a[i]);
      m.x = hn::Add(m.x, ax);
      m.xx = hn::MulAdd(ax, x, m.xx);
      m.y = hn::Add(m.y, b[i]);
      m.xy = hn::MulAdd(b[i], x, m.xy);
      m.yy = hn::Add(m.yy, c[i]);
    }
  }
  return m;
}

/// Returns a bit for each window with a column whose peak reaches the saturation, whether or not in
/// a row of the window.
inline std::uint32_t find_peaks(const FoldedWindows& windows, const StripLine<float>& peaks,
                                float saturation) {
  const FloatTag d;
  FloatVec peak = hn::Zero(d);
  for (int first = 0; first < windows.max_width; first += 4) {
    FloatVec column[4];
    load_columns(peaks.data() + first, windows.begin, column);
    for (int i = 0; i < std::min(4, windows.max_width - first); ++i) {
      const FloatVec x = hn::Sub(hn::Set(d, static_cast<float>(first + i)), windows.half_width);
      peak = hn::Max(peak, hn::IfThenElseZero(hn::Le(x, windows.half_width), column[i]));
    }
  }
  alignas(8) std::uint8_t bytes[8] = {};
  hn::StoreMaskBits(d, hn::Ge(peak, hn::Set(d, saturation)), bytes);
  return bytes[0] | (static_cast<std::uint32_t>(bytes[1]) << 8U);
}

/// Makes y count from `dy` instead, which is relative to where it counted from before.
inline Moments<FloatTag> move_in_y(const Moments<FloatTag>& m, FloatVec dy) {
  const FloatVec y = hn::NegMulAdd(dy, m.s, m.y);
  // Σ(y − dy)² s = Σy² s − dy·(Σy s + Σ(y − dy) s)
  return {
      m.s, m.x, y, m.xx, hn::NegMulAdd(dy, m.x, m.xy), hn::NegMulAdd(dy, hn::Add(m.y, y), m.yy)};
}

/// Folds a strip's column sums and writes the centroids of its lenslets. `spots` points to the
/// window of the first. Saturation does not count; but where a pixel of the strip is saturated, a
/// bit for each lenslet is returned that it may belong to.
inline std::uint32_t fold_strip(const CentroidPlan& plan, const WindowStrips::Lists& lists,
                                const WindowStrip& strip, const WindowSpot* spots,
                                const ColumnSums& sums, float brightest, Centroids& out) {
  const FloatTag d;
  const hn::RebindToSigned<FloatTag> di;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const FloatVec middle =
      hn::Set(d, static_cast<float>(strip.y0) + 0.5F * static_cast<float>(strip.rows - 1));
  std::int32_t begin[kMaxStripLenslets + kWidestVector];
  for (int i = 0; i < strip.n; ++i) begin[i] = place_in_line(strip, spots[i].x0);
  for (int i = strip.n; i < strip.n + lanes; ++i) begin[i] = begin[0];
  std::uint32_t saturated = 0;
  for (int i = 0; i < strip.n; i += lanes) {
    const std::size_t k = as_size(strip.first) + as_size(i);
    const SpotPlaces<FloatTag> places{
        hn::LoadU(d, &lists.centre_x[k]), hn::LoadU(d, &lists.centre_y[k]),
        hn::LoadU(d, &lists.min_x[k]),    hn::LoadU(d, &lists.max_x[k]),
        hn::LoadU(d, &lists.min_y[k]),    hn::LoadU(d, &lists.max_y[k]),
        hn::LoadU(di, &lists.state[k])};
    const FoldedWindows windows{begin + i, hn::LoadU(d, &lists.half_width[k]), strip.min_width,
                                strip.max_width};
    const FloatVec dy = hn::Sub(places.centre_y, middle);
    const auto v = move_in_y(fold_columns(windows, sums.v, sums.v_y, sums.v_yy), dy);
    const auto r = move_in_y(fold_columns(windows, sums.r, sums.r_y, sums.r_yy), dy);
    if (brightest >= plan.saturation)
      saturated |= find_peaks(windows, sums.peak, plan.saturation) << static_cast<unsigned>(i);
    finish_spots(d, plan, places, v, r, hn::Zero(d), k,
                 static_cast<std::size_t>(std::min(lanes, strip.n - i)), out);
  }
  return saturated;
}

}  // namespace curlew::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // per target
