// This file sums the pixels of one window, wherever it is and however large.
//
// Highway compiles it anew for every instruction set, which is why the include guard toggles.
#ifndef CURLEW_WINDOW_PASS_ONCE
#define CURLEW_WINDOW_PASS_ONCE
#include "centroiding/signal_variance.h"

namespace curlew {

/// These are the sums over one window's pixels: the moments, about the window's centre, of the
/// signals v and of the remainders r of their variances. The members are in the order in which
/// sum_window() stores them.
struct WindowSums {
  float v = 0, v_x = 0, v_y = 0, v_xx = 0;
  float v_xy = 0, v_yy = 0, r_xy = 0, r_yy = 0;
  float r = 0, r_x = 0, r_y = 0, r_xx = 0;
  float peak = 0;  ///< brightest good pixel of the window, counts
  // These are what the sums were made with.
  float raised = 0;  ///< of the threshold above the plan's, counts
  SignalVariance model;
};

}  // namespace curlew
#endif  // CURLEW_WINDOW_PASS_ONCE

#if defined(CURLEW_WINDOW_PASS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef CURLEW_WINDOW_PASS_INL_H_
#undef CURLEW_WINDOW_PASS_INL_H_
#else
#define CURLEW_WINDOW_PASS_INL_H_
#endif

#include <algorithm>
#include <cstddef>

#include "centroiding/centroid.h"
#include "centroiding/load_pixels-inl.h"
#include "centroiding/sharp_pixels.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace curlew::HWY_NAMESPACE {

/// A Reader gives one window's pixels, calibrated by the plan's maps, as many at a time as D has
/// lanes.
template <class D, typename Pixel, bool kMaps>
class Reader {
 public:
  using V = hn::Vec<D>;

  /// `raised` says how far the window's threshold lies above the plan's, in counts.
  Reader(const CentroidPlan& plan, const Pixel* pixels, const CentroidPlan::Spot& spot, int start,
         float raised)
      : pixels_(pixels + spot.y0 * plan.frame_cols + start),
        gain_(kMaps ? &plan.gain(spot.y0, start) : nullptr),
        offset_(kMaps ? &plan.offset(spot.y0, start) : nullptr),
        level_(hn::Set(D(), kMaps ? raised : plan.uniform_offset + raised)),
        frame_cols_(plan.frame_cols) {}

  struct Calibrated {
    V count;   ///< 0 where the pixel is bad
    V signal;  ///< gain·count − offset, which may be negative; 0 where the pixel is bad
  };
  Calibrated next_row() {
    const D d;
    const V count = load_pixels(d, pixels_);
    pixels_ += frame_cols_;
    if constexpr (kMaps) {
      const V gain = hn::LoadU(d, gain_);
      const V signal = hn::MulSub(count, gain, hn::Add(hn::LoadU(d, offset_), level_));
      gain_ += frame_cols_;
      offset_ += frame_cols_;
      const auto good = hn::Gt(gain, hn::Zero(d));
      return {hn::IfThenElseZero(good, count), hn::IfThenElseZero(good, signal)};
    } else {
      return {count, hn::Sub(count, level_)};
    }
  }

 private:
  const Pixel* pixels_;
  const float* gain_;
  const float* offset_;
  V level_;
  std::ptrdiff_t frame_cols_;
};

/// A Chunk is the columns of a window that one vector covers. Near the frame's right rim the vector
/// is shifted left instead of reading beyond the row; `inside` tells which lanes count.
template <class D>
struct Chunk {
  Chunk(const CentroidPlan& plan, const CentroidPlan::Spot& spot, int first) {
    const D d;
    const int lanes = static_cast<int>(hn::Lanes(d));
    const int wanted = spot.x0 + first;
    start = std::min(wanted, plan.frame_cols - lanes);
    const auto lane = hn::Iota(d, 0.0F);
    const auto skip = hn::Set(d, static_cast<float>(wanted - start));
    const auto end = hn::Set(d, static_cast<float>(spot.x0 + spot.w - start));
    inside = hn::And(hn::Ge(lane, skip), hn::Lt(lane, end));
    const float left = static_cast<float>(start - spot.x0) - 0.5F * static_cast<float>(spot.w - 1);
    x = hn::Add(lane, hn::Set(d, left));
  }
  int start;
  hn::Mask<D> inside;
  hn::Vec<D> x;  ///< position relative to the window's centre
};

/// Adds one chunk's column sums (Σ, Σy, Σy² down each column) to the window's moments, which are
/// vectors.
template <class D>
struct VectorMoments {
  using V = hn::Vec<D>;
  // The constructor is written out because the compiler's own would not be compiled for this
  // instruction set.
  VectorMoments() : sum(hn::Zero(D())), x(sum), y(sum), xx(sum), xy(sum), yy(sum) {}
  V sum, x, y, xx, xy, yy;

  void add(const Chunk<D>& chunk, V column, V column_y, V column_yy) {
    column = hn::IfThenElseZero(chunk.inside, column);
    column_y = hn::IfThenElseZero(chunk.inside, column_y);
    const V column_x = hn::Mul(column, chunk.x);
    sum = hn::Add(sum, column);
    x = hn::Add(x, column_x);
    y = hn::Add(y, column_y);
    xx = hn::MulAdd(column_x, chunk.x, xx);
    xy = hn::MulAdd(column_y, chunk.x, xy);
    yy = hn::Add(yy, hn::IfThenElseZero(chunk.inside, column_yy));
  }
};

/// Stores the sum over all lanes of each of the four vectors.
template <class D, class V = hn::Vec<D>>
void sum_lanes(D d, V a, V b, V c, V e, float* sums) {
#if HWY_TARGET == HWY_SCALAR
  (void)d;
  sums[0] = hn::GetLane(a);
  sums[1] = hn::GetLane(b);
  sums[2] = hn::GetLane(c);
  sums[3] = hn::GetLane(e);
#else
  // Blocks of four lanes are transposed while they are added; then the blocks are added.
  const V ac = hn::Add(hn::InterleaveLower(d, a, c), hn::InterleaveUpper(d, a, c));
  const V be = hn::Add(hn::InterleaveLower(d, b, e), hn::InterleaveUpper(d, b, e));
  const V abce = hn::Add(hn::InterleaveLower(d, ac, be), hn::InterleaveUpper(d, ac, be));
  const hn::CappedTag<float, 4> d4;
  if constexpr (hn::MaxLanes(D()) > 8) {
    const hn::Half<D> d8;
    const auto half = hn::Add(hn::LowerHalf(d8, abce), hn::UpperHalf(d8, abce));
    hn::StoreU(hn::Add(hn::LowerHalf(d4, half), hn::UpperHalf(d4, half)), d4, sums);
  } else if constexpr (hn::MaxLanes(D()) > 4) {
    hn::StoreU(hn::Add(hn::LowerHalf(d4, abce), hn::UpperHalf(d4, abce)), d4, sums);
  } else {
    hn::StoreU(abce, d4, sums);
  }
#endif
}

/// Returns the window's brightest signal above the fixed threshold, which the relative threshold
/// needs.
template <class D, typename Pixel, bool kMaps>
float brightest(const CentroidPlan& plan, const Pixel* pixels, const CentroidPlan::Spot& spot,
                float raised) {
  const D d;
  auto peak = hn::Zero(d);
  for (int first = 0; first < spot.w; first += static_cast<int>(hn::Lanes(d))) {
    const Chunk<D> chunk(plan, spot, first);
    Reader<D, Pixel, kMaps> reader(plan, pixels, spot, chunk.start, raised);
    auto column = hn::Zero(d);
    for (int row = 0; row < spot.h; ++row) column = hn::Max(column, reader.next_row().signal);
    peak = hn::Max(peak, hn::IfThenElseZero(chunk.inside, column));
  }
  return hn::GetLane(hn::MaxOfLanes(d, peak));
}

/// Returns the same with the light of its neighbours in place of each sharp pixel; `first` is the
/// lenslet's first in the list.
template <typename Pixel>
float brightest_but_sharp(const CentroidPlan& plan, const Pixel* pixels,
                          const CentroidPlan::Spot& spot, const SharpPixels& sharp,
                          std::int32_t first, float raised) noexcept {
  const bool maps = !plan.gain.empty();
  float peak = 0.0F;
  for (int y = spot.y0; y < spot.y0 + spot.h; ++y) {
    for (int x = spot.x0; x < spot.x0 + spot.w; ++x) {
      auto count = static_cast<float>(pixels[static_cast<std::ptrdiff_t>(y) * plan.frame_cols + x]);
      for (std::int32_t i = first; i >= 0; i = sharp.pixels[static_cast<std::size_t>(i)].next) {
        const SharpPixel& hit = sharp.pixels[static_cast<std::size_t>(i)];
        if (hit.x == x && hit.y == y) count = count_instead(pixels, plan.frame_cols, hit);
      }
      const float offset = maps ? plan.offset(y, x) : plan.uniform_offset;
      peak = std::max(peak, (maps ? plan.gain(y, x) : 1.0F) * count - (offset + raised));
    }
  }
  return peak;
}

/// Sums the window in one pass down each chunk of columns. Only VectorMoments multiplies by x, once
/// per column. A relative threshold goes by the brightest signal, which is found where known_peak
/// is negative.
template <class D, typename Pixel, bool kMaps>
WindowSums sum_window(const CentroidPlan& plan, const Pixel* pixels, const CentroidPlan::Spot& spot,
                      const PixelModel& pixel_model, float raised, float known_peak) {
  using V = hn::Vec<D>;
  const D d;
  SignalVariance model = pixel_model.signal;
  if (pixel_model.relative_threshold > 0.0F) {
    const float fixed = pixel_model.threshold;
    const float signal =
        known_peak >= 0.0F ? known_peak : brightest<D, Pixel, kMaps>(plan, pixels, spot, raised);
    const float peak = fixed + signal;
    const float higher = std::max(pixel_model.relative_threshold * peak - fixed, 0.0F);
    model = variance_of_signal(plan, pixel_model.pixel_variance, fixed + higher);
    raised += higher;
  }
  const V width = hn::Set(d, model.width);
  const V curve = hn::Set(d, model.curve);
  const V one = hn::Set(d, 1.0F);

  VectorMoments<D> signal;
  VectorMoments<D> remainder;
  V peak = hn::Zero(d);
  for (int first = 0; first < spot.w; first += static_cast<int>(hn::Lanes(d))) {
    const Chunk<D> chunk(plan, spot, first);
    Reader<D, Pixel, kMaps> reader(plan, pixels, spot, chunk.start, raised);
    V v0 = hn::Zero(d), v1 = v0, v2 = v0;
    V r0 = v0, r1 = v0, r2 = v0;
    V column_peak = v0;
    V y = hn::Set(d, -0.5F * static_cast<float>(spot.h - 1));
    for (int row = 0; row < spot.h; ++row) {
      const auto pixel = reader.next_row();
      const V v = hn::Max(pixel.signal, hn::Zero(d));
      const V near = hn::Min(v, width);
      const V r = hn::Mul(near, near);
      const V vy = hn::Mul(v, y);
      const V ry = hn::Mul(r, y);
      v0 = hn::Add(v0, v);
      v1 = hn::Add(v1, vy);
      v2 = hn::MulAdd(vy, y, v2);
      r0 = hn::Add(r0, r);
      r1 = hn::Add(r1, ry);
      r2 = hn::MulAdd(ry, y, r2);
      column_peak = hn::Max(column_peak, pixel.count);
      y = hn::Add(y, one);
    }
    signal.add(chunk, v0, v1, v2);
    remainder.add(chunk, hn::Mul(r0, curve), hn::Mul(r1, curve), hn::Mul(r2, curve));
    peak = hn::Max(peak, hn::IfThenElseZero(chunk.inside, column_peak));
  }
  WindowSums sums;
  sum_lanes(d, signal.sum, signal.x, signal.y, signal.xx, &sums.v);
  sum_lanes(d, signal.xy, signal.yy, remainder.xy, remainder.yy, &sums.v_xy);
  sum_lanes(d, remainder.sum, remainder.x, remainder.y, remainder.xx, &sums.r);
  sums.peak = hn::GetLane(hn::MaxOfLanes(d, peak));
  sums.raised = raised;
  sums.model = model;
  return sums;
}

/// Puts the light of a sharp pixel's neighbours in place of its own in the sums that sum_window()
/// made.
template <typename Pixel>
void replace_pixel(const CentroidPlan& plan, const Pixel* pixels, const CentroidPlan::Spot& spot,
                   const SharpPixel& sharp, WindowSums& sums) noexcept {
  // What is left of less than this part of a pixel is rounding.
  constexpr float kRounding = 1e-4F;
  const bool maps = !plan.gain.empty();
  const float gain = maps ? plan.gain(sharp.y, sharp.x) : 1.0F;
  const float offset = maps ? plan.offset(sharp.y, sharp.x) : plan.uniform_offset;
  const auto signal = [&](float count) {
    return std::max(gain * count - (offset + sums.raised), 0.0F);
  };
  const auto count =
      static_cast<float>(pixels[static_cast<std::ptrdiff_t>(sharp.y) * plan.frame_cols + sharp.x]);
  const float before = signal(count);
  const float instead = signal(count_instead(pixels, plan.frame_cols, sharp));
  const float v = before - instead;
  const float r = sums.model.remainder(before) - sums.model.remainder(instead);
  const float x = static_cast<float>(sharp.x - spot.x0) - 0.5F * static_cast<float>(spot.w - 1);
  const float y = static_cast<float>(sharp.y - spot.y0) - 0.5F * static_cast<float>(spot.h - 1);
  sums.v -= v;
  sums.v_x -= v * x;
  sums.v_y -= v * y;
  sums.v_xx -= v * x * x;
  sums.v_xy -= v * x * y;
  sums.v_yy -= v * y * y;
  sums.r -= r;
  sums.r_x -= r * x;
  sums.r_y -= r * y;
  sums.r_xx -= r * x * x;
  sums.r_xy -= r * x * y;
  sums.r_yy -= r * y * y;
  if (count >= sums.peak) sums.peak = 0.0F;  // The brightest pixel but this one is not known.
  if (sums.v <= kRounding * v) sums = {.raised = sums.raised, .model = sums.model};
}

}  // namespace curlew::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // per target
