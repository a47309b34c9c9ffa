// This is the centroid kernel. Highway compiles it once for every instruction set and chooses one
// at run time.
#include "centroiding/centroid.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "centroiding/centroid_methods.h"
#include "centroiding/frame_level.h"
#include "centroiding/sharp_pixels.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "centroiding/centroid.cpp"
#include "hwy/foreach_target.h"
// Highway needs foreach_target.h before the headers below.

#include "core/size_check.h"
#include "hwy/highway.h"

#ifndef CURLEW_CENTROID_ONCE
#define CURLEW_CENTROID_ONCE
namespace curlew {
namespace {

/// This model estimates the variance of a thresholded signal v = max(I − T, 0) from v itself. Far
/// above the threshold the variance is (v + T)·k + σ², where k is the counts per electron. Near the
/// threshold, clipping takes most of it away (for Gaussian noise of variance s² centred on T, .3408
/// s² is left). The estimate
///     (v·k + c)·min(v·ramp, 1),  c = T·k + σ²
/// has the right mean, for Poisson plus Gaussian noise, when averaged over pixels of any brightness
/// with 1/ramp = .85·√(c k⁻²) + 1 electron (fitted to within 10 % for T from 1.5 to 20 σ and σ from
/// .5 to 10 e⁻, which is 1.5 % of a spot's variance). It uses a ramp rather than a step because
/// whole counts of about an electron make steps coarse, and because a ramp scatters less.
struct SignalVariance {
  float per_count;  ///< k
  float constant;   ///< c
  float ramp;
};

/// These are the sums over one window's pixels: the moments, about the window's centre, of the
/// signals v and of their variances q. The members are in the order in which sum_window() stores
/// them.
struct WindowSums {
  float v, v_x, v_y, v_xx;
  float v_xy, v_yy, q_xy, q_yy;
  float q, q_x, q_y, q_xx;
  float peak;  ///< brightest good pixel of the window, counts
  // These are what the sums were made with.
  float raised;  ///< of the threshold above the plan's, counts
  SignalVariance model;
};

SignalVariance variance_of_signal(const CentroidPlan& plan, float pixel_variance,
                                  float threshold) noexcept {
  const float k = plan.counts_per_e;
  const float c = threshold * k + pixel_variance;
  const float width = 0.85F * std::sqrt(c) + 1.0F * k;
  return {.per_count = k, .constant = c, .ramp = width > 0.0F ? 1.0F / width : 0.0F};
}

/// A variance that is estimated from the very photons it describes scatters. In a circulation of
/// four lenslets of F electrons each, this scatter is a relative variance of about 1.5/F, and so
/// the ratio D/σ has Student's longer tails. Therefore the variance is widened by 4/F. Then D
/// beyond 2.8 to 4.1 σ is as frequent as for a Gaussian within 20 % (Monte Carlo at 200 and 1000
/// photons; at 1000 the widening is .5 %).
constexpr float kWidening = 4.0F;

/// What the frame at hand says of its pixels, or else the calibration.
struct PixelModel {
  PixelModel(const CentroidPlan& plan, const FrameLevels* levels) noexcept
      : level(levels != nullptr ? levels->level.data() : nullptr),
        threshold(levels != nullptr ? levels->threshold : plan.threshold),
        pixel_variance(levels != nullptr ? levels->pixel_variance : plan.pixel_variance),
        signal(variance_of_signal(plan, pixel_variance, threshold)) {}

  /// How far lenslet k's threshold lies above that in the plan's offsets, in counts.
  float raised(const CentroidPlan& plan, std::size_t k) const noexcept {
    return level != nullptr ? level[k] + (threshold - plan.threshold) : 0.0F;
  }

  const float* level;    ///< [lenslets] above the calibration's dark; null: the calibration's
  float threshold;       ///< T without the relative threshold, counts
  float pixel_variance;  ///< counts²
  SignalVariance signal;
};

}  // namespace
}  // namespace curlew
#endif  // CURLEW_CENTROID_ONCE

HWY_BEFORE_NAMESPACE();
namespace curlew::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

template <class D>
hn::Vec<D> load_pixels(D d, const std::uint16_t* p) {
  const hn::Rebind<std::uint16_t, D> narrow;
  const hn::Rebind<std::int32_t, D> wide;
  return hn::ConvertTo(d, hn::PromoteTo(wide, hn::LoadU(narrow, p)));
}

template <class D>
hn::Vec<D> load_pixels(D d, const std::uint8_t* p) {
  const hn::Rebind<std::uint8_t, D> narrow;
  const hn::Rebind<std::int32_t, D> wide;
  return hn::ConvertTo(d, hn::PromoteTo(wide, hn::LoadU(narrow, p)));
}

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
    V count;  ///< 0 where the pixel is bad
    V gain;
    V signal;  ///< gain·count − offset, which may be negative
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
      return {hn::IfThenElseZero(hn::Gt(gain, hn::Zero(d)), count), gain, signal};
    } else {
      return {count, count, hn::Sub(count, level_)};
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

/// Sums the window in one pass down each chunk of columns. Only VectorMoments multiplies by x, once
/// per column.
template <class D, typename Pixel, bool kMaps>
WindowSums sum_window(const CentroidPlan& plan, const Pixel* pixels, const CentroidPlan::Spot& spot,
                      const PixelModel& pixel_model, float raised) {
  using V = hn::Vec<D>;
  const D d;
  SignalVariance model = pixel_model.signal;
  if (plan.relative_threshold > 0.0F) {
    const float fixed = pixel_model.threshold;
    const float peak = fixed + brightest<D, Pixel, kMaps>(plan, pixels, spot, raised);
    const float higher = std::max(plan.relative_threshold * peak - fixed, 0.0F);
    model = variance_of_signal(plan, pixel_model.pixel_variance, fixed + higher);
    raised += higher;
  }
  const V per_count = hn::Set(d, model.per_count);
  const V constant = hn::Set(d, model.constant);
  const V ramp = hn::Set(d, model.ramp);
  const V one = hn::Set(d, 1.0F);

  VectorMoments<D> signal;
  VectorMoments<D> variance;
  V peak = hn::Zero(d);
  for (int first = 0; first < spot.w; first += static_cast<int>(hn::Lanes(d))) {
    const Chunk<D> chunk(plan, spot, first);
    Reader<D, Pixel, kMaps> reader(plan, pixels, spot, chunk.start, raised);
    V v0 = hn::Zero(d), v1 = v0, v2 = v0;
    V q0 = v0, q1 = v0, q2 = v0;
    V column_peak = v0;
    V y = hn::Set(d, -0.5F * static_cast<float>(spot.h - 1));
    for (int row = 0; row < spot.h; ++row) {
      const auto pixel = reader.next_row();
      const V v = hn::Max(pixel.signal, hn::Zero(d));
      V q = hn::Mul(hn::MulAdd(v, per_count, constant), hn::Min(hn::Mul(v, ramp), one));
      if constexpr (kMaps) q = hn::Mul(q, pixel.gain);
      const V vy = hn::Mul(v, y);
      const V qy = hn::Mul(q, y);
      v0 = hn::Add(v0, v);
      v1 = hn::Add(v1, vy);
      v2 = hn::MulAdd(vy, y, v2);
      q0 = hn::Add(q0, q);
      q1 = hn::Add(q1, qy);
      q2 = hn::MulAdd(qy, y, q2);
      column_peak = hn::Max(column_peak, pixel.count);
      y = hn::Add(y, one);
    }
    signal.add(chunk, v0, v1, v2);
    variance.add(chunk, q0, q1, q2);
    peak = hn::Max(peak, hn::IfThenElseZero(chunk.inside, column_peak));
  }
  WindowSums sums;
  sum_lanes(d, signal.sum, signal.x, signal.y, signal.xx, &sums.v);
  sum_lanes(d, signal.xy, signal.yy, variance.xy, variance.yy, &sums.v_xy);
  sum_lanes(d, variance.sum, variance.x, variance.y, variance.xx, &sums.q);
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
  const auto variance = [&](float v) {
    return (v * sums.model.per_count + sums.model.constant) * std::min(v * sums.model.ramp, 1.0F) *
           gain;
  };
  const auto count =
      static_cast<float>(pixels[static_cast<std::ptrdiff_t>(sharp.y) * plan.frame_cols + sharp.x]);
  const float before = signal(count);
  const float instead = signal(count_instead(pixels, plan.frame_cols, sharp));
  const float v = before - instead;
  const float q = variance(before) - variance(instead);
  const float x = static_cast<float>(sharp.x - spot.x0) - 0.5F * static_cast<float>(spot.w - 1);
  const float y = static_cast<float>(sharp.y - spot.y0) - 0.5F * static_cast<float>(spot.h - 1);
  sums.v -= v;
  sums.v_x -= v * x;
  sums.v_y -= v * y;
  sums.v_xx -= v * x * x;
  sums.v_xy -= v * x * y;
  sums.v_yy -= v * y * y;
  sums.q -= q;
  sums.q_x -= q * x;
  sums.q_y -= q * y;
  sums.q_xx -= q * x * x;
  sums.q_xy -= q * x * y;
  sums.q_yy -= q * y * y;
  if (count >= sums.peak) sums.peak = 0.0F;  // The brightest pixel but this one is not known.
  if (sums.v <= kRounding * v || sums.q <= kRounding * q) sums = {};
}

void clear(Centroids& out, std::size_t k, LensletState state, float flux_adu) noexcept {
  out.x_px[k] = out.y_px[k] = 0.0F;
  out.xx_px2[k] = out.yy_px2[k] = out.xy_px2[k] = 0.0F;
  out.variance_x_px2[k] = out.variance_y_px2[k] = out.covariance_xy_px2[k] = 0.0F;
  out.flux_adu[k] = flux_adu;
  out.state[k] = state;
}

/// Writes the lenslet's centroid, noise and state from its window's sums.
void finish(const CentroidPlan& plan, const CentroidPlan::Spot& spot, const WindowSums& sums,
            std::size_t k, Centroids& out) noexcept {
  const float flux_adu = sums.v * plan.adu_per_count;
  LensletState state = spot.state;
  if (state == LensletState::kValid && sums.peak >= plan.saturation) {
    state = LensletState::kSaturated;
    ++out.n_saturated;
  }
  if (state == LensletState::kValid &&
      !(sums.v > 0.0F && sums.v * sums.v >= plan.min_snr_squared * sums.q)) {
    state = LensletState::kFaint;
  }
  const bool described = state == LensletState::kValid || state == LensletState::kFaint;
  if (!described || !(sums.v > 0.0F)) return clear(out, k, state, flux_adu);

  const float inverse = 1.0F / sums.v;
  const float x = sums.v_x * inverse;
  const float y = sums.v_y * inverse;
  if (state == LensletState::kValid &&
      (x < spot.min_x || x > spot.max_x || y < spot.min_y || y > spot.max_y)) {
    state = LensletState::kAtEdge;
  }
  out.x_px[k] = (static_cast<float>(spot.x0) + 0.5F * static_cast<float>(spot.w - 1)) + x;
  out.y_px[k] = (static_cast<float>(spot.y0) + 0.5F * static_cast<float>(spot.h - 1)) + y;
  out.flux_adu[k] = flux_adu;
  out.xx_px2[k] = std::max(sums.v_xx * inverse - x * x, 0.0F);
  out.yy_px2[k] = std::max(sums.v_yy * inverse - y * y, 0.0F);
  out.xy_px2[k] = sums.v_xy * inverse - x * y;
  const float scale = (1.0F + kWidening * plan.counts_per_e * inverse) * inverse * inverse;
  out.variance_x_px2[k] =
      std::max((sums.q_xx - 2.0F * x * sums.q_x + x * x * sums.q) * scale, 0.0F);
  out.variance_y_px2[k] =
      std::max((sums.q_yy - 2.0F * y * sums.q_y + y * y * sums.q) * scale, 0.0F);
  out.covariance_xy_px2[k] = (sums.q_xy - x * sums.q_y - y * sums.q_x + x * y * sums.q) * scale;
  // Counts that are no light, as of a damaged map, must not spread.
  if (!std::isfinite(x + y + flux_adu + out.xx_px2[k] + out.yy_px2[k] + out.xy_px2[k] +
                     out.variance_x_px2[k] + out.variance_y_px2[k] + out.covariance_xy_px2[k]))
    return clear(out, k, LensletState::kBadPixels, 0.0F);
  out.state[k] = state;
  out.n_valid += state == LensletState::kValid ? 1 : 0;
}

template <typename Pixel, bool kMaps>
void measure_rows(const CentroidPlan& plan, FrameView frame, int first, int last,
                  const PixelModel& model, const FrameConditions& conditions, Centroids& out) {
  const auto* pixels = frame.data<Pixel>();
  const SharpPixels* sharp = conditions.sharp;
  const Image<CentroidPlan::Spot>& windows = windows_of(plan, conditions);
  const auto cols = static_cast<std::size_t>(plan.spots.cols());
  for (std::size_t k = static_cast<std::size_t>(first) * cols;
       k < static_cast<std::size_t>(last) * cols; ++k) {
    if (conditions.only != nullptr) {
      if ((*conditions.only)[k] == 0) continue;
      out.n_valid -= out.state[k] == LensletState::kValid ? 1 : 0;
      out.n_saturated -= out.state[k] == LensletState::kSaturated ? 1 : 0;
    }
    const CentroidPlan::Spot& spot = windows[k];
    if (spot.state == LensletState::kUnlit || spot.state == LensletState::kLost) {
      clear(out, k, spot.state, 0.0F);
      continue;
    }
    // This is the narrowest vector that holds the window, but never wider than the frame.
    const int width = std::min(spot.w > 8 ? 16 : spot.w > 4 ? 8 : 4, plan.frame_cols);
    const float raised = model.raised(plan, k);
    WindowSums sums;
    if (width >= 16) {
      sums = sum_window<hn::CappedTag<float, 16>, Pixel, kMaps>(plan, pixels, spot, model, raised);
    } else if (width >= 8) {
      sums = sum_window<hn::CappedTag<float, 8>, Pixel, kMaps>(plan, pixels, spot, model, raised);
    } else {
      sums = sum_window<hn::CappedTag<float, 4>, Pixel, kMaps>(plan, pixels, spot, model, raised);
    }
    if (sharp != nullptr)
      for (std::int32_t i = sharp->first[k]; i >= 0;
           i = sharp->pixels[static_cast<std::size_t>(i)].next)
        replace_pixel(plan, pixels, spot, sharp->pixels[static_cast<std::size_t>(i)], sums);
    finish(plan, spot, sums, k, out);
  }
}

void measure(const CentroidPlan& plan, FrameView frame, int first, int last,
             const FrameConditions& conditions, Centroids& out) {
  const bool maps = !plan.gain.empty();
  const PixelModel model(plan, conditions.levels);
  if (frame.pixel_type == PixelType::kU16) {
    maps ? measure_rows<std::uint16_t, true>(plan, frame, first, last, model, conditions, out)
         : measure_rows<std::uint16_t, false>(plan, frame, first, last, model, conditions, out);
  } else {
    maps ? measure_rows<std::uint8_t, true>(plan, frame, first, last, model, conditions, out)
         : measure_rows<std::uint8_t, false>(plan, frame, first, last, model, conditions, out);
  }
}

}  // namespace
}  // namespace curlew::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace curlew {

HWY_EXPORT(measure);

void find_centroids_rows(const CentroidPlan& plan, FrameView frame, int first, int last,
                         Centroids& centroids, const FrameConditions& conditions) noexcept {
  check_size("find_centroids", "a frame", {frame.rows, frame.cols},
             {plan.frame_rows, plan.frame_cols});
  check_size("find_centroids", "centroids", size_of(centroids.state), size_of(plan.spots));
  if (first == 0 && conditions.only == nullptr) centroids.n_valid = centroids.n_saturated = 0;
  HWY_DYNAMIC_DISPATCH(measure)(plan, frame, first, last, conditions, centroids);
  if (!is_centre_of_gravity(plan.method))
    find_positions(plan, frame, first, last, centroids, conditions);
}

void find_centroids(const CentroidPlan& plan, FrameView frame, Centroids& centroids,
                    const FrameConditions& conditions) noexcept {
  find_centroids_rows(plan, frame, 0, plan.spots.rows(), centroids, conditions);
}

}  // namespace curlew
#endif  // HWY_ONCE
