// Highway compiles the search for every instruction set and chooses one at run time.
#include "centroiding/pixel_search.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "centroiding/pixel_search.cpp"
#include "hwy/foreach_target.h"
// Highway needs foreach_target.h before the headers below.

#include "centroiding/pixel_faults.h"
#include "hwy/highway.h"

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

/// The counts of a vector of pixels and of their neighbours.
template <class D>
struct Neighbourhood {
  hn::Vec<D> here, along_x, along_y;  ///< the brighter neighbour along each axis
};

template <class D>
class FaultTest {
 public:
  static constexpr int kReach = 1;

  explicit FaultTest(const RoughFaults& test)
      : steepness_(hn::Set(D(), test.steepness)),
        dark_(hn::Set(D(), test.dark)),
        margin_(hn::Set(D(), test.margin)),
        dead_(hn::Set(D(), test.dead)),
        lit_(hn::Set(D(), test.lit)),
        whole_steepness_(test.whole_steepness) {}

  HWY_INLINE hn::Mask<D> passes(const Neighbourhood<D>& of) const {
    const hn::Vec<D> brighter = hn::Min(of.along_x, of.along_y);
    hn::Vec<D> steep = hn::MulHigh(brighter, steepness_);
    for (int i = 0; i < whole_steepness_; ++i) steep = hn::SaturatedAdd(steep, brighter);
    const hn::Vec<D> least = hn::SaturatedAdd(hn::SaturatedSub(steep, dark_), margin_);
    const auto lit = hn::Gt(hn::Max(of.along_x, of.along_y), lit_);
    return hn::Or(hn::Gt(of.here, hn::SaturatedAdd(brighter, least)),
                  hn::And(hn::Lt(of.here, dead_), lit));
  }

 private:
  hn::Vec<D> steepness_, dark_, margin_, dead_, lit_;
  int whole_steepness_;
};

template <class D>
class ClumpTest {
 public:
  static constexpr int kReach = 2;

  explicit ClumpTest(const RoughClumps& test)
      : inverse_(hn::Set(D(), test.inverse)),
        dark_(hn::Set(D(), test.dark)),
        margin_(hn::Set(D(), test.margin)) {}

  HWY_INLINE hn::Mask<D> passes(const Neighbourhood<D>& of) const {
    const hn::Vec<D> brighter = hn::Min(of.along_x, of.along_y);
    const hn::Vec<D> most = hn::SaturatedAdd(hn::MulHigh(of.here, inverse_), dark_);
    return hn::And(hn::Lt(brighter, most), hn::Gt(of.here, hn::SaturatedAdd(brighter, margin_)));
  }

 private:
  hn::Vec<D> inverse_, dark_, margin_;
};

/// Searches rows [first_row, last_row). It walks the frame's memory straight on, over the ends of
/// rows: the last pixels of a row stand beside the first of the next, and both are of the rim.
/// There must be more than a vector of pixels between the frame's row kReach and `last_row`.
template <class D, typename Pixel, class Test>
void search_with(D d, FrameView frame, int first_row, int last_row, const Test& test,
                 FixedList<SharpPixel>& found) {
  constexpr std::ptrdiff_t kReach = Test::kReach;
  const auto cols = static_cast<std::ptrdiff_t>(frame.cols);
  const auto lanes = static_cast<std::ptrdiff_t>(hn::Lanes(d));
  const std::ptrdiff_t begin = cols * first_row;
  const std::ptrdiff_t end = cols * last_row;
  for (std::ptrdiff_t first = begin; first < end; first += lanes) {
    const std::ptrdiff_t at = std::min(first, end - lanes);  // The last vector is shifted back.
    const Pixel* p = frame.data<Pixel>() + at;
    const auto passed =
        test.passes({load(d, p), hn::Max(load(d, p - kReach), load(d, p + kReach)),
                     hn::Max(load(d, p - kReach * cols), load(d, p + kReach * cols))});
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
      if (x >= kReach && x < cols - kReach)
        found.push({static_cast<std::int32_t>(x), static_cast<std::int32_t>(i / cols), -1});
    }
  }
}

template <template <class> class Test, typename Pixel, typename Rough>
void search(FrameView frame, int first_row, int last_row, const Rough& test,
            FixedList<SharpPixel>& found) {
  const hn::CappedTag<std::uint16_t, 32> wide;
  const hn::CappedTag<std::uint16_t, 8> narrow;
  using Wide = decltype(wide);
  using Narrow = decltype(narrow);
  const std::int64_t before = std::int64_t{frame.cols} * (last_row - Test<Wide>::kReach);
  if (before >= static_cast<std::int64_t>(hn::Lanes(wide)))
    search_with<Wide, Pixel>(wide, frame, first_row, last_row, Test<Wide>(test), found);
  else if (before >= static_cast<std::int64_t>(hn::Lanes(narrow)))
    search_with<Narrow, Pixel>(narrow, frame, first_row, last_row, Test<Narrow>(test), found);
}

void find_faults(FrameView frame, int first_row, int last_row, const RoughFaults& test,
                 FixedList<SharpPixel>& found) {
  if (frame.pixel_type == PixelType::kU16)
    search<FaultTest, std::uint16_t>(frame, first_row, last_row, test, found);
  else
    search<FaultTest, std::uint8_t>(frame, first_row, last_row, test, found);
}

void find_clumps(FrameView frame, int first_row, int last_row, const RoughClumps& test,
                 FixedList<SharpPixel>& found) {
  if (frame.pixel_type == PixelType::kU16)
    search<ClumpTest, std::uint16_t>(frame, first_row, last_row, test, found);
  else
    search<ClumpTest, std::uint8_t>(frame, first_row, last_row, test, found);
}

}  // namespace
}  // namespace curlew::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace curlew {
namespace {

HWY_EXPORT(find_faults);
HWY_EXPORT(find_clumps);

constexpr float kMost = 65535.0F;

std::uint16_t whole_count(float value) noexcept {
  return static_cast<std::uint16_t>(std::clamp(value, 0.0F, kMost));
}

/// Returns by how many counts a pixel must exceed its neighbours. The exact test asks that its
/// light exceeds theirs by `sigmas` times its own noise, √(σ² + k·light). Neighbours count as 0 at
/// least, so that light which is fainter than so many times its noise never passes; half of that
/// is asked for here, for the sake of pixels whose gain is up to 2.
float margin_of(const FrameLevels& levels, float sigmas, float counts_per_e) noexcept {
  constexpr float kLeast = 0.5F;
  const float variance = levels.pixel_variance;
  const float a = 0.5F * sigmas * sigmas * counts_per_e;
  const float faintest = a + std::sqrt(a * a + sigmas * sigmas * variance);
  return std::floor(std::max(kLeast * faintest, kSharpSigmas * std::sqrt(variance)));
}

}  // namespace

/// Above a dark level L, light > q·n + m is count > q·n + m − (q − 1)·L. The highest L makes the
/// test let through all of these. Since no light counts as less than 0, each of them also exceeds n
/// by m, which noise hardly ever does.
RoughFaults rough_faults(const SharpPixelPlan& plan, const FrameLevels& levels,
                         float counts_per_e) noexcept {
  const float steepness = std::max(plan.sharpness - 1.0F, 0.0F);
  const float whole = std::floor(steepness);
  const float lowest = plan.low_dark + levels.floor;
  const float darkest = plan.low_dark + std::min(levels.floor, 0.0F);
  return {.whole_steepness = whole_count(whole),
          .steepness = whole_count(65536.0F * (steepness - whole)),
          .dark = whole_count(std::ceil(steepness * (plan.dark + levels.bound))),
          .margin = whole_count(
              plan.sharpness > 0.0F ? margin_of(levels, kSharpSigmas, counts_per_e) : kMost),
          .dead = whole_count(std::ceil(darkest - dead_depth(levels))),
          .lit = whole_count(std::floor(lowest + levels.threshold))};
}

/// The same is n < count/q + (1 − 1/q)·L − m/q. Rounding takes less than two counts.
RoughClumps rough_clumps(const SharpPixelPlan& plan, const FrameLevels& levels,
                         float counts_per_e) noexcept {
  constexpr float kRounding = 2.0F;
  const float inverse = 1.0F / plan.clump_sharpness;
  const float highest = plan.dark + levels.bound;
  return {.inverse = whole_count(65536.0F * inverse),
          .dark = whole_count(std::ceil((1.0F - inverse) * highest) + kRounding),
          .margin = whole_count(margin_of(levels, kClumpSigmas, counts_per_e))};
}

void search_faults(FrameView frame, int first_row, int last_row, RoughFaults test,
                   FixedList<SharpPixel>& found) noexcept {
  HWY_DYNAMIC_DISPATCH(find_faults)(frame, first_row, last_row, test, found);
}

void search_clumps(FrameView frame, int first_row, int last_row, RoughClumps test,
                   FixedList<SharpPixel>& found) noexcept {
  HWY_DYNAMIC_DISPATCH(find_clumps)(frame, first_row, last_row, test, found);
}

}  // namespace curlew
#endif  // HWY_ONCE
