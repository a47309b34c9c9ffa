// This is the centroid kernel. Highway compiles it once for every instruction set and chooses one
// at run time. row_pass-inl.h and column_fold-inl.h measure windows that lie side by side, and
// window_pass-inl.h measures any other; docs/performance.md explains them.
#include "centroiding/centroid.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "centroiding/centroid_methods.h"
#include "centroiding/frame_level.h"
#include "centroiding/sharp_pixels.h"
#include "centroiding/signal_variance.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "centroiding/centroid.cpp"
#include "hwy/foreach_target.h"
// Highway needs foreach_target.h before the headers below.

#include "centroiding/column_fold-inl.h"
#include "centroiding/row_pass-inl.h"
#include "centroiding/spot_finish-inl.h"
#include "centroiding/window_pass-inl.h"
#include "core/as_size.h"
#include "core/size_check.h"
#include "core/team.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace curlew::HWY_NAMESPACE {
namespace {

void clear(Centroids& out, std::size_t k, LensletState state) noexcept {
  out.x_px[k] = out.y_px[k] = out.flux_adu[k] = 0.0F;
  out.xx_px2[k] = out.yy_px2[k] = out.xy_px2[k] = 0.0F;
  out.variance_x_px2[k] = out.variance_y_px2[k] = out.covariance_xy_px2[k] = 0.0F;
  out.state[k] = state;
}

/// Measures the lenslets of one frame.
template <typename Pixel>
class Kernel {
 public:
  Kernel(const CentroidPlan& plan, FrameView frame, const FrameConditions& conditions,
         Centroids& out)
      : plan_(plan),
        pixels_(frame.data<Pixel>()),
        conditions_(conditions),
        windows_(windows_of(plan, conditions)),
        model_(plan, conditions.levels,
               conditions.cores ? plan.core_threshold : plan.relative_threshold),
        out_(out) {}

  /// Measures lenslet rows [first, last).
  void measure(int first, int last) {
    const WindowStrips* strips = strips_of(plan_, conditions_);
    if (conditions_.only != nullptr || conditions_.cores || plan_.relative_threshold > 0.0F ||
        !strips_fit()) {
      strips = nullptr;
    }
    const int cols = plan_.spots.cols();
    for (int row = first; row < last; ++row) {
      int k = row * cols;
      if (strips != nullptr) {
        for (const WindowStrip& strip : strips->of_row(row)) {
          measure_each(k, strip.first);
          measure_strip(strip, strips->after(strip), strips->lists());
          k = strip.first + strip.n;
        }
      }
      measure_each(k, (row + 1) * cols);
    }
  }

 private:
  /// Returns whether the maps are such that strips can be measured.
  bool strips_fit() const {
    return plan_.gain.empty() || !plan_.words.empty() || !plan_.codes.empty();
  }

  /// Measures a strip, after which `next` is measured.
  void measure_strip(const WindowStrip& strip, const WindowStrip& next,
                     const WindowStrips::Lists& lists) {
    ahead_ = (next.y0 - strip.y0) * std::ptrdiff_t{plan_.frame_cols} + next.x0 - strip.x0;
    positions_.place(strip.rows);
    const float brightest = sum_strip(strip);
    if (brightest < 0.0F) return measure_each(strip.first, strip.first + strip.n);
    const WindowSpot* spots = &windows_[static_cast<std::size_t>(strip.first)];
    const std::uint32_t saturated = fold_strip(plan_, lists, strip, spots, sums_, brightest, out_);
    // What is rare is measured by windows.
    const SharpPixels* sharp = conditions_.sharp;
    const bool any_hit = sharp != nullptr && (sharp->any_broken || !sharp->pixels.empty());
    if (saturated == 0 && !any_hit) return;
    for (int i = 0; i < strip.n; ++i) {
      const int k = strip.first + i;
      const bool hit = any_hit && (sharp->first[as_size(k)] >= 0 || sharp->broken[as_size(k)] != 0);
      if (hit || (saturated >> static_cast<unsigned>(i) & 1U) != 0) measure_one(as_size(k));
    }
  }

  /// Sums a strip's columns by the fastest of the ways that suit it. Returns its brightest pixel,
  /// or −1 if there is no such way.
  float sum_strip(const WindowStrip& strip) {
    if (plan_.gain.empty()) return sum_with(NoMaps{}, plan_.uniform_offset, strip);
    float brightest = -1.0F;
    if (!plan_.words.empty()) brightest = sum_with_words(strip);
    if (brightest < 0.0F && !plan_.codes.empty())
      brightest = sum_with(plan_.codes, plan_.codes.offset_base, strip);
    return brightest;
  }

  template <class Maps>
  float sum_with(const Maps& maps, float offset, const WindowStrip& strip) {
    constexpr float kBeyondReach = 1e30F;
    float values[kMaxStripLenslets];
    for (int i = 0; i < strip.n; ++i)
      values[i] = offset + model_.raised(plan_, as_size(strip.first) + as_size(i));
    set_thresholds(strip, &windows_[static_cast<std::size_t>(strip.first)], values, kBeyondReach,
                   thresholds_);
    return sum_columns(maps, pixels_, plan_.frame_cols, strip, thresholds_, positions_,
                       model_.signal, ahead_, sums_);
  }

  /// Returns −1 if a number does not fit into 16 bits.
  float sum_with_words(const WindowStrip& strip) {
    constexpr std::uint16_t kBeyondReach = 0xFFFF;
    const PixelWords& words = plan_.words;
    const float per_unit = 1.0F / words.unit;
    std::uint16_t values[kMaxStripLenslets];
    for (int i = 0; i < strip.n; ++i) {
      const float raised = model_.raised(plan_, as_size(strip.first) + as_size(i));
      const float units = (words.offset_base + raised) * per_unit + 0.5F;
      if (!(units >= 0.0F && units < 65000.0F)) return -1.0F;
      values[i] = static_cast<std::uint16_t>(units);
    }
    set_thresholds(strip, &windows_[static_cast<std::size_t>(strip.first)], values, kBeyondReach,
                   whole_thresholds_);
    const float brightest = sum_columns(words, pixels_, plan_.frame_cols, strip, whole_thresholds_,
                                        positions_, model_.signal, ahead_, signals_, sums_);
    return brightest <= words.max_count() ? brightest : -1.0F;
  }

  /// Measures lenslets [first, last) one by one.
  void measure_each(int first, int last) {
    for (int k = first; k < last; ++k) {
      if (conditions_.cores) {
        if (out_.state[static_cast<std::size_t>(k)] == LensletState::kValid) measure_core(k);
      } else if (conditions_.only != nullptr) {
        if ((*conditions_.only)[static_cast<std::size_t>(k)] != 0) measure_one(as_size(k));
      } else {
        measure_one(static_cast<std::size_t>(k));
      }
    }
  }

  void measure_core(int lenslet) {
    const auto k = static_cast<std::size_t>(lenslet);
    const float flux_adu = out_.flux_adu[k];
    const float xx_px2 = out_.xx_px2[k], yy_px2 = out_.yy_px2[k], xy_px2 = out_.xy_px2[k];
    measure_one(k);
    out_.flux_adu[k] = flux_adu;
    out_.xx_px2[k] = xx_px2;
    out_.yy_px2[k] = yy_px2;
    out_.xy_px2[k] = xy_px2;
  }

  void measure_one(std::size_t k) {
    const WindowSpot& spot = windows_[k];
    if (spot.state == LensletState::kUnlit || spot.state == LensletState::kLost)
      return clear(out_, k, spot.state);
    WindowSums sums = plan_.gain.empty() ? sum_of<false>(spot, k) : sum_of<true>(spot, k);
    const SharpPixels* sharp = conditions_.sharp;
    if (sharp != nullptr)
      for (std::int32_t i = sharp->first[k]; i >= 0;
           i = sharp->pixels[static_cast<std::size_t>(i)].next)
        replace_pixel(plan_, pixels_, spot, sharp->pixels[static_cast<std::size_t>(i)], sums);

    const bool broken = sharp != nullptr && sharp->broken[k] != 0;
    const LensletState state = broken ? LensletState::kBadPixels : spot.state;
    const hn::CappedTag<float, 4> d;
    const hn::RebindToSigned<decltype(d)> di;
    const auto set = [&](float value) { return hn::Set(d, value); };
    finish_spots(
        d, plan_,
        {set(spot.centre_x()), set(spot.centre_y()), set(spot.min_x), set(spot.max_x),
         set(spot.min_y), set(spot.max_y), hn::Set(di, static_cast<std::int32_t>(state))},
        {set(sums.v), set(sums.v_x), set(sums.v_y), set(sums.v_xx), set(sums.v_xy), set(sums.v_yy)},
        {set(sums.r), set(sums.r_x), set(sums.r_y), set(sums.r_xx), set(sums.r_xy), set(sums.r_yy)},
        set(sums.peak), k, 1, out_);
  }

  template <bool kMaps>
  WindowSums sum_of(const WindowSpot& spot, std::size_t k) const {
    // This is the narrowest vector that holds the window, but never wider than the frame.
    const int width = std::min(spot.w > 8 ? 16 : spot.w > 4 ? 8 : 4, plan_.frame_cols);
    const float raised = model_.raised(plan_, k);
    const SharpPixels* sharp = conditions_.sharp;
    const bool hit = model_.relative_threshold > 0.0F && sharp != nullptr && sharp->first[k] >= 0;
    const float peak =
        hit ? brightest_but_sharp(plan_, pixels_, spot, *sharp, sharp->first[k], raised) : -1.0F;
    if (width >= 16)
      return sum_window<hn::CappedTag<float, 16>, Pixel, kMaps>(plan_, pixels_, spot, model_,
                                                                raised, peak);
    if (width >= 8)
      return sum_window<hn::CappedTag<float, 8>, Pixel, kMaps>(plan_, pixels_, spot, model_, raised,
                                                               peak);
    return sum_window<hn::CappedTag<float, 4>, Pixel, kMaps>(plan_, pixels_, spot, model_, raised,
                                                             peak);
  }

  const CentroidPlan& plan_;
  const Pixel* pixels_;
  const FrameConditions& conditions_;
  const Image<WindowSpot>& windows_;
  const PixelModel model_;
  Centroids& out_;
  // Buffers of one strip, which are not cleared, for only what is written is read.
  std::ptrdiff_t ahead_ = 0;  // from this strip to the next one, pixels
  RowPositions positions_;
  alignas(64) StripThresholds<float> thresholds_;
  alignas(64) StripThresholds<std::uint16_t> whole_thresholds_;
  alignas(64) WholeSignals signals_;
  alignas(64) ColumnSums sums_;
};

void measure(const CentroidPlan& plan, FrameView frame, int first, int last,
             const FrameConditions& conditions, Centroids& out) {
  if (frame.pixel_type == PixelType::kU16)
    Kernel<std::uint16_t>(plan, frame, conditions, out).measure(first, last);
  else
    Kernel<std::uint8_t>(plan, frame, conditions, out).measure(first, last);
}

}  // namespace
}  // namespace curlew::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace curlew {

HWY_EXPORT(measure);

namespace {

/// Adds `one` for each valid and each saturated lenslet of rows [first, last) to the counts.
void count_states(int first, int last, int one, Centroids& centroids) noexcept {
  const std::ptrdiff_t cols = centroids.state.cols();
  const LensletState* begin = centroids.state.begin() + first * cols;
  const LensletState* end = centroids.state.begin() + last * cols;
  const auto count = [&](LensletState state) {
    return one * static_cast<int>(std::count(begin, end, state));
  };
  centroids.n_valid += count(LensletState::kValid);
  centroids.n_saturated += count(LensletState::kSaturated);
}

}  // namespace

void find_centroids_rows(const CentroidPlan& plan, FrameView frame, int first, int last,
                         Centroids& centroids, const FrameConditions& conditions) noexcept {
  check_size("find_centroids", "a frame", {frame.rows, frame.cols},
             {plan.frame_rows, plan.frame_cols});
  check_size("find_centroids", "centroids", size_of(centroids.state), size_of(plan.spots));
  if (conditions.only != nullptr || conditions.cores)
    count_states(first, last, -1, centroids);
  else if (first == 0)
    centroids.n_valid = centroids.n_saturated = 0;
  share_rows(conditions.team, first, last, [&](int, int begin, int end) {
    HWY_DYNAMIC_DISPATCH(measure)(plan, frame, begin, end, conditions, centroids);
    if (!is_centre_of_gravity(plan.method))
      find_positions(plan, frame, begin, end, centroids, conditions);
  });
  count_states(first, last, 1, centroids);
}

void find_centroids(const CentroidPlan& plan, FrameView frame, Centroids& centroids,
                    const FrameConditions& conditions) noexcept {
  find_centroids_rows(plan, frame, 0, plan.spots.rows(), centroids, conditions);
}

void find_core_positions(const CentroidPlan& plan, FrameView frame, Centroids& centroids,
                         FrameConditions conditions) noexcept {
  if (!(plan.core_threshold > 0.0F)) return;
  conditions.cores = true;
  find_centroids(plan, frame, centroids, conditions);
}

}  // namespace curlew
#endif  // HWY_ONCE
