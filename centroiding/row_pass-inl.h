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
inline constexpr int kBeforeStrip = 2 * kWidestVector;
template <typename T>
using StripLine = std::array<T, kBeforeStrip + kMaxStripCols + 2 * kWidestVector>;

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

/// What a pixel's count is held against, less what its code says: in counts, or in whole units of
/// PixelWords.
template <typename T>
struct StripThresholds {
  std::array<const T*, kMaxStripRows> of_row;       ///< a line for each row of the strip
  StripLine<T> core;                                ///< for the rows that all windows have
  std::array<StripLine<T>, kMaxUnevenRows> uneven;  ///< for the others
};

/// These are sums down each column, of the signals v and of the remainders r of their variances. y
/// counts from the strip's middle.
struct ColumnSums {
  StripLine<float> v, v_y, v_yy;
  StripLine<float> r, r_y, r_yy;
  StripLine<float> peak;  ///< brightest good pixel in all of the strip's rows, counts
};

/// Signals of two vectors of columns, in units of PixelWords.
using WholeSignals = std::array<std::array<std::uint16_t, 2 * kWidestVector>, kMaxStripRows>;

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
template <typename T>
void set_in_window(const WindowStrip& strip, const WindowSpot& spot, T value, StripLine<T>& line) {
  const hn::CappedTag<T, kWidestVector> d;
  T* to = line.data() + place_in_line(strip, spot.x0);
  for (int i = 0; i < spot.w; i += static_cast<int>(hn::Lanes(d)))
    hn::StoreU(hn::Set(d, value), d, to + i);
}

/// Prepares the thresholds of a strip, whose first lenslet's window `spots` points to. `values` are
/// those of its lenslets. In rows that a window does not have, no count reaches `beyond_reach`.
template <typename T>
void set_thresholds(const WindowStrip& strip, const WindowSpot* spots, const T* values,
                    T beyond_reach, StripThresholds<T>& thresholds) {
  for (int i = 0; i < strip.n; ++i) set_in_window(strip, spots[i], values[i], thresholds.core);
  std::size_t uneven = 0;
  for (int y = strip.y0; y < strip.y0 + strip.rows; ++y) {
    StripLine<T>* line = &thresholds.core;
    if (y < strip.core || y >= strip.core_end) {
      line = &thresholds.uneven[uneven++];
      for (int i = 0; i < strip.n; ++i) {
        const bool has = y >= spots[i].y0 && y < spots[i].y0 + spots[i].h;
        set_in_window(strip, spots[i], has ? values[i] : beyond_reach, *line);
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

template <typename Pixel>
RowPixels read_pixels(const PixelCodes& codes, const Pixel* pixels, std::ptrdiff_t at,
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

template <typename Pixel>
void prefetch(const PixelCodes& codes, const Pixel* pixels, std::ptrdiff_t at) {
  hwy::Prefetch(pixels + at);
  hwy::Prefetch(codes.gain.data() + at);
  hwy::Prefetch(codes.offset.data() + at);
}

/// Sums of one vector of columns.
class ColumnSummer {
 public:
  // The constructor is written out because the compiler's own would not be compiled for this
  // instruction set.
  explicit ColumnSummer(float width)
      : width_(hn::Set(FloatTag(), width)),
        v_(hn::Zero(FloatTag())),
        v_y_(v_),
        v_yy_(v_),
        r_(v_),
        r_y_(v_),
        r_yy_(v_) {}

  void add(FloatVec v, const RowPositions& positions, std::size_t row) {
    const FloatTag d;
    const FloatVec y = hn::Set(d, positions.y[row]);
    const FloatVec yy = hn::Set(d, positions.yy[row]);
    const FloatVec near = hn::Min(v, width_);
    const FloatVec r = hn::Mul(near, near);
    v_ = hn::Add(v_, v);
    v_y_ = hn::MulAdd(v, y, v_y_);
    v_yy_ = hn::MulAdd(v, yy, v_yy_);
    r_ = hn::Add(r_, r);
    r_y_ = hn::MulAdd(r, y, r_y_);
    r_yy_ = hn::MulAdd(r, yy, r_yy_);
  }

  /// Stores the sums, times `v_scale` and `r_scale`, at a place of the lines.
  void store(float v_scale, float r_scale, int place, ColumnSums& sums) const {
    const FloatTag d;
    const FloatVec v = hn::Set(d, v_scale), r = hn::Set(d, r_scale);
    hn::StoreU(hn::Mul(v_, v), d, sums.v.data() + place);
    hn::StoreU(hn::Mul(v_y_, v), d, sums.v_y.data() + place);
    hn::StoreU(hn::Mul(v_yy_, v), d, sums.v_yy.data() + place);
    hn::StoreU(hn::Mul(r_, r), d, sums.r.data() + place);
    hn::StoreU(hn::Mul(r_y_, r), d, sums.r_y.data() + place);
    hn::StoreU(hn::Mul(r_yy_, r), d, sums.r_yy.data() + place);
  }

 private:
  FloatVec width_;
  FloatVec v_, v_y_, v_yy_, r_, r_y_, r_yy_;
};

/// Sums the strip's columns. Returns its brightest good pixel, which may lie beside the windows.
/// The strip that comes next begins `ahead` pixels on. Its pixels are called for here, because the
/// processor does not foresee walks down columns.
template <typename Pixel, class Maps>
float sum_columns(const Maps& maps, const Pixel* pixels, int frame_cols, const WindowStrip& strip,
                  const StripThresholds<float>& thresholds, const RowPositions& positions,
                  const SignalVariance& model, std::ptrdiff_t ahead, ColumnSums& sums) {
  const FloatTag d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  FloatVec brightest = hn::Zero(d);
  for (int first = 0; first < strip.cols; first += lanes) {
    // The last vector may be shifted back, on to the frame. It finds again what was found there.
    const int column = std::min(strip.x0 + first, frame_cols - lanes);
    const int place = place_in_line(strip, column);
    std::ptrdiff_t at = static_cast<std::ptrdiff_t>(strip.y0) * frame_cols + column;
    ColumnSummer summer(model.width);
    FloatVec peak = hn::Zero(d);
    for (std::size_t row = 0; row < static_cast<std::size_t>(strip.rows); ++row) {
      prefetch(maps, pixels, at + ahead);
      const RowPixels pixel = read_pixels(maps, pixels, at, thresholds.of_row[row] + place);
      summer.add(pixel.signal, positions, row);
      if constexpr (std::is_same_v<Maps, NoMaps>)
        peak = hn::Max(peak, pixel.count);
      else
        peak = hn::IfThenElse(pixel.good, hn::Max(peak, pixel.count), peak);
      at += frame_cols;
    }
    summer.store(1.0F, model.curve, place, sums);
    hn::StoreU(peak, d, sums.peak.data() + place);
    brightest = hn::Max(brightest, peak);
  }
  return hn::GetLane(hn::MaxOfLanes(d, brightest));
}

using WholeTag = hn::CappedTag<std::uint16_t, std::size_t{2} * kWidestVector>;
using WholeVec = hn::Vec<WholeTag>;

inline WholeVec load_whole(const std::uint16_t* p) { return hn::LoadU(WholeTag(), p); }
inline WholeVec load_whole(const std::uint8_t* p) {
  return hn::PromoteTo(WholeTag(), hn::LoadU(hn::Rebind<std::uint8_t, WholeTag>(), p));
}

/// Finds the signals of a vector of columns, from pixel `at` down. Returns the brightest good
/// counts.
template <typename Pixel>
WholeVec find_signals(const PixelWords& maps, const Pixel* pixels, std::ptrdiff_t at,
                      int frame_cols, int rows, const StripThresholds<std::uint16_t>& thresholds,
                      int place, WholeSignals& signals) {
  const WholeTag d;
  const WholeVec bad = hn::Set(d, PixelWords::kBadWord);
  const WholeVec low_byte = hn::Set(d, std::uint16_t{0xFF});
  const WholeVec gain_mask = hn::Set(d, maps.gain_mask);
  const WholeVec scale = hn::Set(d, static_cast<std::uint16_t>(maps.count_scale));
  WholeVec peak = hn::Zero(d);
  for (std::size_t row = 0; row < static_cast<std::size_t>(rows); ++row, at += frame_cols) {
    const WholeVec count = load_whole(pixels + at);
    const WholeVec word = load_whole(maps.words.data() + at);
    const auto good = hn::Ne(word, bad);
    const WholeVec offset =
        hn::SaturatedAdd(load_whole(thresholds.of_row[row] + place), hn::And(word, low_byte));
    const WholeVec c = hn::Mul(count, scale);
    const WholeVec h = hn::And(hn::ShiftRight<PixelWords::kGainShift>(word), gain_mask);
    const WholeVec fall = hn::MulHigh(c, h);
    const WholeVec signal = hn::SaturatedSub(hn::Sub(c, fall), offset);
    hn::StoreU(hn::IfThenElseZero(good, signal), d, signals[row].data());
    peak = hn::IfThenElse(good, hn::Max(peak, count), peak);
  }
  return peak;
}

/// Does the same as the other sum_columns(), with thresholds in whole units. What it stores is of
/// no use if the brightest pixel exceeds PixelWords::max_count().
template <typename Pixel>
float sum_columns(const PixelWords& maps, const Pixel* pixels, int frame_cols,
                  const WindowStrip& strip, const StripThresholds<std::uint16_t>& thresholds,
                  const RowPositions& positions, const SignalVariance& model, std::ptrdiff_t ahead,
                  WholeSignals& signals, ColumnSums& sums) {
  const FloatTag d;
  const WholeTag whole;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const int columns = static_cast<int>(hn::Lanes(whole));
  WholeVec brightest = hn::Zero(whole);
  for (int first = 0; first < strip.cols; first += columns) {
    const int column = std::min(strip.x0 + first, frame_cols - columns);
    const int place = place_in_line(strip, column);
    const std::ptrdiff_t at = static_cast<std::ptrdiff_t>(strip.y0) * frame_cols + column;
    const WholeVec peak =
        find_signals(maps, pixels, at, frame_cols, strip.rows, thresholds, place, signals);
    brightest = hn::Max(brightest, peak);
    HWY_ALIGN std::uint16_t peaks[2 * kWidestVector];
    hn::Store(peak, whole, peaks);
    for (int i = 0; i < columns; i += lanes) {
      ColumnSummer summer(model.width / maps.unit);
      std::ptrdiff_t next = at + ahead;
      for (std::size_t row = 0; row < static_cast<std::size_t>(strip.rows); ++row) {
        if (i == 0)
          hwy::Prefetch(pixels + next);
        else
          hwy::Prefetch(maps.words.data() + next);
        summer.add(load_pixels(d, signals[row].data() + i), positions, row);
        next += frame_cols;
      }
      summer.store(maps.unit, maps.unit * maps.unit * model.curve, place + i, sums);
      hn::StoreU(load_pixels(d, peaks + i), d, sums.peak.data() + place + i);
    }
  }
  HWY_ALIGN std::uint16_t all[2 * kWidestVector];
  hn::Store(brightest, whole, all);
  return static_cast<float>(*std::max_element(all, all + columns));
}

}  // namespace curlew::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // per target
