// This file walks the pixels of a strip once, by whole rows, into sums of its columns.
//
// Highway compiles it anew for every instruction set, which is why the include guard toggles.
#ifndef CURLEW_ROW_PASS_ONCE
#define CURLEW_ROW_PASS_ONCE
#include <array>
#include <cstddef>
#include <cstdint>

#include "centroiding/signal_variance.h"
#include "centroiding/window_strips.h"

namespace curlew {

// A line has a value for each column of a strip. Vectors may begin before the strip, at the right
// rim of the frame, and end behind it.
inline constexpr int kBeforeStrip = kWidestVector;
using StripLine = std::array<float, kBeforeStrip + kMaxStripCols + 2 * kWidestVector>;

/// Returns where the first value of a column of the frame stands in a line.
inline int place_in_line(const WindowStrip& strip, int column) noexcept {
  return kBeforeStrip + column - strip.x0;
}

/// How far the rows of a strip lie from its middle, in px.
struct RowPositions {
  int rows = 0;  ///< for which the others hold
  std::array<float, kMaxStripRows> y;
  std::array<float, kMaxStripRows> yy;  ///< y²

  void place(int n) noexcept {
    if (rows == n) return;
    rows = n;
    for (int i = 0; i < n; ++i) {
      const float at = static_cast<float>(i) - 0.5F * static_cast<float>(n - 1);
      y[static_cast<std::size_t>(i)] = at;
      yy[static_cast<std::size_t>(i)] = at * at;
    }
  }
};

/// What a pixel's count is held against, less what its code says, in counts.
struct StripThresholds {
  std::array<const float*, kMaxStripRows> of_row;  ///< a line for each row of the strip
  StripLine core;                                  ///< for the rows that all windows have
  std::array<StripLine, kMaxUnevenRows> uneven;    ///< for the others
};

/// These are sums down each column, of the signals v and of the remainders r of their variances. y
/// counts from the strip's middle.
struct ColumnSums {
  StripLine v, v_y, v_yy;
  StripLine r, r_y, r_yy;
  StripLine peak;  ///< brightest good pixel in all of the strip's rows, counts
};

/// Pixels of a sensor without dark, flat and bad pixels.
struct NoMaps {};

}  // namespace curlew
#endif  // CURLEW_ROW_PASS_ONCE

#if defined(CURLEW_ROW_PASS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef CURLEW_ROW_PASS_INL_H_
#undef CURLEW_ROW_PASS_INL_H_
#else
#define CURLEW_ROW_PASS_INL_H_
#endif

#include <algorithm>
#include <type_traits>

#include "centroiding/load_pixels-inl.h"
#include "hwy/cache_control.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace curlew::HWY_NAMESPACE {

using FloatTag = hn::CappedTag<float, kWidestVector>;
using FloatVec = hn::Vec<FloatTag>;

/// Sets a line's values within the columns of a window, and some values behind them.
inline void set_in_window(const WindowStrip& strip, const WindowSpot& spot, float value,
                          StripLine& line) {
  const FloatTag d;
  float* to = line.data() + place_in_line(strip, spot.x0);
  for (int i = 0; i < spot.w; i += static_cast<int>(hn::Lanes(d)))
    hn::StoreU(hn::Set(d, value), d, to + i);
}

/// Prepares the thresholds of a strip, whose first lenslet's window `spots` points to. In rows that
/// a window does not have, no count reaches its threshold. `base` goes with the plan's offsets.
inline void set_thresholds(const CentroidPlan& plan, const WindowStrip& strip,
                           const WindowSpot* spots, const PixelModel& model, float base,
                           StripThresholds& thresholds) {
  constexpr float kBeyondReach = 1e30F;
  float raised[kMaxStripLenslets];
  for (int i = 0; i < strip.n; ++i) {
    raised[i] = base + model.raised(plan, static_cast<std::size_t>(strip.first + i));
    set_in_window(strip, spots[i], raised[i], thresholds.core);
  }
  std::size_t uneven = 0;
  for (int y = strip.y0; y < strip.y0 + strip.rows; ++y) {
    StripLine* line = &thresholds.core;
    if (y < strip.core || y >= strip.core_end) {
      line = &thresholds.uneven[uneven++];
      for (int i = 0; i < strip.n; ++i) {
        const bool has = y >= spots[i].y0 && y < spots[i].y0 + spots[i].h;
        set_in_window(strip, spots[i], has ? raised[i] : kBeyondReach, *line);
      }
    }
    thresholds.of_row[static_cast<std::size_t>(y - strip.y0)] = line->data();
  }
}

/// Some pixels of one row.
struct RowPixels {
  FloatVec count;
  FloatVec signal;  ///< v ≥ 0; 0 where the pixel is bad
  hn::Mask<FloatTag> good;
};

template <typename Pixel>
RowPixels read_pixels(const NoMaps& /*maps*/, const Pixel* pixels, std::ptrdiff_t at,
                      const float* threshold) {
  const FloatTag d;
  const FloatVec count = load_pixels(d, pixels + at);
  const FloatVec signal = hn::Max(hn::Sub(count, hn::LoadU(d, threshold)), hn::Zero(d));
  return {count, signal, hn::Eq(count, count)};
}

template <typename Pixel, typename Code>
RowPixels read_pixels(const PixelCodes<Code>& codes, const Pixel* pixels, std::ptrdiff_t at,
                      const float* threshold) {
  const FloatTag d;
  const FloatVec count = load_pixels(d, pixels + at);
  const FloatVec gain_code = load_pixels(d, codes.gain.data() + at);
  const FloatVec gain =
      hn::MulAdd(gain_code, hn::Set(d, codes.gain_step), hn::Set(d, codes.gain_base));
  const FloatVec offset = hn::MulAdd(load_pixels(d, codes.offset.data() + at),
                                     hn::Set(d, codes.offset_step), hn::LoadU(d, threshold));
  const auto good = hn::Gt(gain_code, hn::Zero(d));
  const FloatVec signal = hn::Max(hn::MulSub(count, gain, offset), hn::Zero(d));
  return {count, hn::IfThenElseZero(good, signal), good};
}

template <typename Pixel>
void prefetch(const NoMaps& /*maps*/, const Pixel* pixels, std::ptrdiff_t at) {
  hwy::Prefetch(pixels + at);
}

template <typename Pixel, typename Code>
void prefetch(const PixelCodes<Code>& codes, const Pixel* pixels, std::ptrdiff_t at) {
  hwy::Prefetch(pixels + at);
  hwy::Prefetch(codes.gain.data() + at);
  hwy::Prefetch(codes.offset.data() + at);
}

/// Sums the strip's columns. Returns its brightest good pixel, which may lie beside the windows.
/// The strip that comes next begins `ahead` pixels on. Its pixels are called for here, because the
/// processor does not foresee walks down columns.
template <typename Pixel, class Maps>
float sum_columns(const Maps& maps, const Pixel* pixels, int frame_cols, const WindowStrip& strip,
                  const StripThresholds& thresholds, const RowPositions& positions,
                  const SignalVariance& model, std::ptrdiff_t ahead, ColumnSums& sums) {
  const FloatTag d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const FloatVec zero = hn::Zero(d);
  const FloatVec width = hn::Set(d, model.width);
  const FloatVec square = hn::Set(d, model.square);
  const FloatVec linear = hn::Set(d, model.linear);
  FloatVec brightest = zero;
  for (int first = 0; first < strip.cols; first += lanes) {
    // The last vector may be shifted back, on to the frame. It finds again what was found there.
    const int column = std::min(strip.x0 + first, frame_cols - lanes);
    const int place = place_in_line(strip, column);
    std::ptrdiff_t at = static_cast<std::ptrdiff_t>(strip.y0) * frame_cols + column;
    FloatVec v0 = zero, v1 = zero, v2 = zero;
    FloatVec r0 = zero, r1 = zero, r2 = zero;
    FloatVec peak = zero;
    for (int row = 0; row < strip.rows; ++row) {
      const auto i = static_cast<std::size_t>(row);
      prefetch(maps, pixels, at + ahead);
      const RowPixels pixel = read_pixels(maps, pixels, at, thresholds.of_row[i] + place);
      const FloatVec y = hn::Set(d, positions.y[i]);
      const FloatVec yy = hn::Set(d, positions.yy[i]);
      const FloatVec v = pixel.signal;
      const FloatVec u = hn::Min(v, width);
      const FloatVec r = hn::Mul(u, hn::MulAdd(u, square, linear));
      v0 = hn::Add(v0, v);
      v1 = hn::MulAdd(v, y, v1);
      v2 = hn::MulAdd(v, yy, v2);
      r0 = hn::Add(r0, r);
      r1 = hn::MulAdd(r, y, r1);
      r2 = hn::MulAdd(r, yy, r2);
      if constexpr (std::is_same_v<Maps, NoMaps>)
        peak = hn::Max(peak, pixel.count);
      else
        peak = hn::IfThenElse(pixel.good, hn::Max(peak, pixel.count), peak);
      at += frame_cols;
    }
    hn::StoreU(v0, d, sums.v.data() + place);
    hn::StoreU(v1, d, sums.v_y.data() + place);
    hn::StoreU(v2, d, sums.v_yy.data() + place);
    hn::StoreU(r0, d, sums.r.data() + place);
    hn::StoreU(r1, d, sums.r_y.data() + place);
    hn::StoreU(r2, d, sums.r_yy.data() + place);
    hn::StoreU(peak, d, sums.peak.data() + place);
    brightest = hn::Max(brightest, peak);
  }
  return hn::GetLane(hn::MaxOfLanes(d, brightest));
}

}  // namespace curlew::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // per target
