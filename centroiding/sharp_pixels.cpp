#include "centroiding/sharp_pixels.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <vector>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "centroiding/sharp_pixels.cpp"
#include "hwy/foreach_target.h"
// Highway needs foreach_target.h before the headers below.

#include "core/as_size.h"
#include "core/size_check.h"
#include "hwy/highway.h"

#ifndef CURLEW_SHARP_PIXELS_ONCE
#define CURLEW_SHARP_PIXELS_ONCE
namespace curlew {
namespace {

constexpr float kSigmas = 4.5F;

/// This is what all pixels are held against first, in whole counts. It lets through all that is
/// sharp and little else. A pixel passes if its count exceeds that of its second brightest
/// neighbour by more than margin + max(steepness·second − dark, 0).
struct RoughTest {
  std::uint16_t whole_steepness;  ///< steepness is sharpness − 1
  std::uint16_t steepness;        ///< the rest of it, in 1/65536
  std::uint16_t dark;             ///< steepness times the frame's highest dark level, rounded up
  std::uint16_t margin;
};

RoughTest rough_test(float sharpness, float dark, float margin) noexcept {
  const auto count = [](float value) {
    return static_cast<std::uint16_t>(std::clamp(value, 0.0F, 65535.0F));
  };
  const float steepness = std::max(sharpness - 1.0F, 0.0F);
  const float whole = std::floor(steepness);
  return {.whole_steepness = count(whole),
          .steepness = count(65536.0F * (steepness - whole)),
          .dark = count(std::ceil(steepness * dark)),
          .margin = count(std::floor(margin))};
}

float second_brightest(float left, float right, float above, float below) noexcept {
  const float high = std::max(left, right), low = std::min(left, right);
  const float high2 = std::max(above, below), low2 = std::min(above, below);
  return std::max(std::min(high, high2), std::max(low, low2));
}

}  // namespace
}  // namespace curlew
#endif  // CURLEW_SHARP_PIXELS_ONCE

HWY_BEFORE_NAMESPACE();
namespace curlew::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

template <class D>
hn::Vec<D> load(D d, const std::uint16_t* p) {
  return hn::LoadU(d, p);
}

template <class D>
hn::Vec<D> load(D d, const std::uint8_t* p) {
  return hn::PromoteTo(d, hn::LoadU(hn::Rebind<std::uint8_t, D>(), p));
}

/// Lists the pixels of rows [first_row, last_row) that pass the rough test, but for those of the
/// frame's rim, which have too few neighbours. It walks the frame's memory straight on, over the
/// ends of rows: the last pixel of a row stands beside the first of the next, and both are of the
/// rim. There must be more than a vector of pixels between the frame's first row and `last_row`.
template <class D, typename Pixel>
void look_over(D d, FrameView frame, int first_row, int last_row, RoughTest test,
               FixedList<SharpPixel>& candidates) {
  using V = hn::Vec<D>;
  const auto cols = static_cast<std::ptrdiff_t>(frame.cols);
  const auto lanes = static_cast<std::ptrdiff_t>(hn::Lanes(d));
  const std::ptrdiff_t begin = cols * first_row;
  const std::ptrdiff_t end = cols * last_row;
  const V steepness = hn::Set(d, test.steepness);
  const V dark = hn::Set(d, test.dark);
  const V margin = hn::Set(d, test.margin);
  for (std::ptrdiff_t first = begin; first < end; first += lanes) {
    const std::ptrdiff_t at = std::min(first, end - lanes);  // The last vector is shifted back.
    const Pixel* p = frame.data<Pixel>() + at;
    const V here = load(d, p);
    const V left = load(d, p - 1), right = load(d, p + 1), above = load(d, p - cols),
            below = load(d, p + cols);
    const V second = hn::Max(hn::Min(hn::Max(left, right), hn::Max(above, below)),
                             hn::Max(hn::Min(left, right), hn::Min(above, below)));
    V steep = hn::MulHigh(second, steepness);
    for (int i = 0; i < test.whole_steepness; ++i) steep = hn::SaturatedAdd(steep, second);
    const V least = hn::SaturatedAdd(hn::SaturatedSub(steep, dark), margin);
    const auto passed = hn::Gt(here, hn::SaturatedAdd(second, least));
    if (hn::AllFalse(d, passed)) continue;
    // The lanes are taken from bits here: a call of a function that is not compiled for this
    // instruction set costs a hundred times as much as the test.
    alignas(8) std::uint8_t bytes[8] = {};
    hn::StoreMaskBits(d, passed, bytes);
    std::uint32_t bits = 0;
    for (unsigned i = 0; i < 4; ++i) bits |= static_cast<std::uint32_t>(bytes[i]) << (8U * i);
    bits &= ~0U << static_cast<unsigned>(first - at);  // The others were seen before.
    for (; bits != 0; bits &= bits - 1) {
      const std::ptrdiff_t i = at + std::countr_zero(bits);
      const std::ptrdiff_t x = i % cols;
      if (x > 0 && x < cols - 1)
        candidates.push({static_cast<std::int32_t>(x), static_cast<std::int32_t>(i / cols), -1});
    }
  }
}

template <typename Pixel>
void look_over(FrameView frame, int first_row, int last_row, RoughTest test,
               FixedList<SharpPixel>& candidates) {
  const hn::CappedTag<std::uint16_t, 32> wide;
  const hn::CappedTag<std::uint16_t, 8> narrow;
  const std::int64_t before = std::int64_t{frame.cols} * (last_row - 1);
  if (before >= static_cast<std::int64_t>(hn::Lanes(wide))) {
    look_over<decltype(wide), Pixel>(wide, frame, first_row, last_row, test, candidates);
  } else if (before >= static_cast<std::int64_t>(hn::Lanes(narrow))) {
    look_over<decltype(narrow), Pixel>(narrow, frame, first_row, last_row, test, candidates);
  }
}

void look(FrameView frame, int first_row, int last_row, RoughTest test,
          FixedList<SharpPixel>& candidates) {
  if (frame.pixel_type == PixelType::kU16)
    look_over<std::uint16_t>(frame, first_row, last_row, test, candidates);
  else
    look_over<std::uint8_t>(frame, first_row, last_row, test, candidates);
}

}  // namespace
}  // namespace curlew::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace curlew {

HWY_EXPORT(look);

namespace {

float count_at(FrameView frame, int x, int y) noexcept {
  const std::size_t i = as_size(y) * as_size(frame.cols) + as_size(x);
  return frame.pixel_type == PixelType::kU16 ? static_cast<float>(frame.data<std::uint16_t>()[i])
                                             : static_cast<float>(frame.data<std::uint8_t>()[i]);
}

/// Returns the pixel's light above the lenslet's level, in counts; 0 for a bad pixel.
float light_at(const CentroidPlan& plan, FrameView frame, float level, int x, int y) noexcept {
  const float count = count_at(frame, x, y);
  if (plan.gain.empty()) return count - (plan.uniform_offset - plan.threshold + level);
  const float gain = plan.gain(y, x);
  return gain > 0.0F ? gain * count - (plan.offset(y, x) - plan.threshold + level) : 0.0F;
}

bool is_sharp(const SharpPixelPlan& plan, const CentroidPlan& centroid, FrameView frame,
              const FrameLevels& levels, std::size_t k, int x, int y) noexcept {
  const auto light = [&](int at_x, int at_y) {
    return light_at(centroid, frame, levels.level[k], at_x, at_y);
  };
  const float here = light(x, y);
  const float second =
      second_brightest(light(x - 1, y), light(x + 1, y), light(x, y - 1), light(x, y + 1));
  const float variance = levels.pixel_variance + std::max(here, 0.0F) * centroid.counts_per_e;
  return here > plan.sharpness * std::max(second, 0.0F) + kSigmas * std::sqrt(variance);
}

bool contains(const CentroidPlan::Spot& spot, int x, int y) noexcept {
  return x >= spot.x0 && x < spot.x0 + spot.w && y >= spot.y0 && y < spot.y0 + spot.h;
}

/// Lists the candidate with every lenslet whose sharp pixel it is. Returns false, and does nothing,
/// if the level of these lenslets is not known yet.
bool assign(const SharpPixelPlan& plan, const CentroidPlan& centroid,
            const Image<CentroidPlan::Spot>& windows, FrameView frame, const FrameLevels& levels,
            const SharpPixel& candidate, SharpPixels& sharp) noexcept {
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
  for (int r = std::max(r0 - 1, 0); r <= last; ++r) {
    for (int c = std::max(c0 - 1, 0); c <= std::min(c0 + 1, cols - 1); ++c) {
      const std::size_t k = as_size(r) * as_size(cols) + as_size(c);
      const CentroidPlan::Spot& spot = windows[k];
      if (spot.state == LensletState::kUnlit || !contains(spot, candidate.x, candidate.y) ||
          !is_sharp(plan, centroid, frame, levels, k, candidate.x, candidate.y))
        continue;
      const auto index = static_cast<std::int32_t>(sharp.pixels.size());
      if (sharp.pixels.push({candidate.x, candidate.y, sharp.first[k]})) sharp.first[k] = index;
    }
  }
  return true;
}

/// Returns the sharpness of a Gaussian spot in the middle of a pixel, where it is greatest; NaN if
/// σ is NaN.
double sharpness_of_gaussian(double sigma_px) noexcept {
  const auto light_within = [&](double px) { return std::erf(px / (std::sqrt(2.0) * sigma_px)); };
  const double middle = light_within(0.5);
  return 2.0 * middle / (light_within(1.5) - middle);
}

}  // namespace

SharpPixelPlan::SharpPixelPlan(const Sensor& sensor, const FrameFormat& format)
    : grid(sensor.grid) {
  constexpr double kMargin = 1.4;
  constexpr double kUndersampled = 4.0;  // Sharper spots are as sharp as a cosmic ray.
  const double allowed =
      kMargin * std::fmax(sensor.spot_sharpness, sharpness_of_gaussian(sensor.spot_gaussian_px));
  sharpness = allowed > 1.0 && allowed <= kUndersampled ? static_cast<float>(allowed) : 0.0F;
  auto high_adu = static_cast<float>(sensor.background_adu);
  if (!sensor.dark_adu.empty()) {
    std::vector<float> darks;
    std::copy_if(sensor.dark_adu.begin(), sensor.dark_adu.end(), std::back_inserter(darks),
                 [](float value) { return std::isfinite(value); });
    const std::size_t place = darks.size() - darks.size() / 100 - 1;  // 1 % are hot pixels
    if (!darks.empty()) {
      std::nth_element(darks.begin(), darks.begin() + static_cast<std::ptrdiff_t>(place),
                       darks.end());
      high_adu = darks[place];
    }
  }
  dark = (high_adu - static_cast<float>(format.zero_adu)) / static_cast<float>(format.scale_adu);
}

SharpPixels::SharpPixels(int rows, int cols)
    : pixels(4 * as_size(rows) * as_size(cols) + 64),
      candidates(pixels.capacity()),
      first(rows, cols, -1) {}

void begin_sharp_pixels(SharpPixels& sharp) noexcept {
  sharp.candidates.clear();
  sharp.pixels.clear();
  sharp.first.fill(-1);
  sharp.pixel_rows = 0;
  sharp.assigned = 0;
}

int find_sharp_pixels_rows(const SharpPixelPlan& plan, const CentroidPlan& centroid,
                           const Image<CentroidPlan::Spot>& windows, FrameView frame, int ready,
                           const FrameLevels& levels, SharpPixels& sharp) noexcept {
  check_size("find_sharp_pixels", "a frame", {frame.rows, frame.cols},
             {centroid.frame_rows, centroid.frame_cols});
  check_size("find_sharp_pixels", "lenslets", size_of(sharp.first), size_of(centroid.spots));
  check_size("find_sharp_pixels", "windows", size_of(windows), size_of(centroid.spots));
  if (plan.sharpness <= 0.0F) return ready;
  // The row below each must be there, and those at the frame's rim have too few neighbours.
  const int first = std::max(sharp.pixel_rows, 1);
  const int last = ready - 1;
  constexpr std::int64_t kLanes = 32;  // Before the frame is whole, a vector must fit.
  const bool wide = std::int64_t{frame.cols} * (last - 1) >= kLanes;
  if (first < last && (wide || ready == frame.rows)) {
    // Above a dark level L, light > q·second + m is count > q·second + m − (q − 1)·L. The highest L
    // makes the rough test let through all of these. Since no light counts as less than 0, each of
    // them also exceeds its second brightest neighbour by m, which noise hardly ever does.
    const RoughTest test = rough_test(plan.sharpness, plan.dark + levels.bound,
                                      kSigmas * std::sqrt(levels.pixel_variance));
    HWY_DYNAMIC_DISPATCH(look)(frame, first, last, test, sharp.candidates);
    sharp.pixel_rows = last;
  }
  while (sharp.assigned < sharp.candidates.size()) {
    const SharpPixel& candidate = sharp.candidates[sharp.assigned];
    if (!assign(plan, centroid, windows, frame, levels, candidate, sharp)) return candidate.y;
    ++sharp.assigned;
  }
  return ready == frame.rows ? ready : sharp.pixel_rows;
}

void find_sharp_pixels(const SharpPixelPlan& plan, const CentroidPlan& centroid,
                       const Image<CentroidPlan::Spot>& windows, FrameView frame,
                       const FrameLevels& levels, SharpPixels& sharp) noexcept {
  begin_sharp_pixels(sharp);
  find_sharp_pixels_rows(plan, centroid, windows, frame, frame.rows, levels, sharp);
}

void assign_sharp_pixels(const SharpPixelPlan& plan, const CentroidPlan& centroid,
                         const Image<CentroidPlan::Spot>& windows, FrameView frame,
                         const FrameLevels& levels, SharpPixels& sharp) noexcept {
  sharp.pixels.clear();
  sharp.first.fill(-1);
  sharp.assigned = 0;
  sharp.pixel_rows = frame.rows;
  find_sharp_pixels_rows(plan, centroid, windows, frame, frame.rows, levels, sharp);
}

}  // namespace curlew
#endif  // HWY_ONCE
