#include "centroiding/centroid_methods.h"

#include <cstddef>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "centroiding/centroid_methods.cpp"
#include "hwy/foreach_target.h"
// Highway needs foreach_target.h before the headers below.

#include "centroiding/brightest_centroid-inl.h"
#include "centroiding/correlation_centroid-inl.h"
#include "centroiding/frame_level.h"
#include "centroiding/likelihood_centroid-inl.h"
#include "centroiding/weighted_centroid-inl.h"
#include "centroiding/window_group.h"
#include "centroiding/window_lanes-inl.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace curlew::HWY_NAMESPACE {
namespace {

void find(const CentroidPlan& plan, FrameView frame, int first, int last,
          const FrameConditions& conditions, Centroids& out) {
  alignas(64) WindowBuffer light;  // It is not cleared, for only what is loaded is read.
  alignas(64) GroupPositions found;
  const std::size_t lanes = lane_count();
  WindowGroup group;
  const float pixel_variance =
      conditions.levels != nullptr ? conditions.levels->pixel_variance : plan.pixel_variance;
  const auto measure = [&] {
    describe_windows(plan, conditions, out, lanes, group);
    load_windows(plan, frame, group, lanes, conditions, light.data());
    const Windows windows{group,   light.data(),           group.w,
                          group.h, set(plan.counts_per_e), set(pixel_variance)};
    switch (plan.method) {
      case CentroidMethod::kCorrelation:
        find_correlation(plan, windows, found);
        break;
      case CentroidMethod::kBrightestPixels:
        find_brightest(plan, windows, found);
        break;
      case CentroidMethod::kMaximumLikelihood:
        find_most_likely(plan, windows, found);
        break;
      default:
        find_weighted(plan, windows, plan.reference_pull, found);
    }
    for (std::size_t lane = 0; lane < group.n; ++lane)
      adopt_position(plan, conditions, found, lane, group.lenslet[lane], out);
    group.n = 0;
  };
  const auto cols = static_cast<std::size_t>(plan.spots.cols());
  for (std::size_t k = static_cast<std::size_t>(first) * cols;
       k < static_cast<std::size_t>(last) * cols; ++k) {
    if (conditions.only != nullptr && (*conditions.only)[k] == 0) continue;
    if (out.state[k] != LensletState::kValid && out.state[k] != LensletState::kFaint) continue;
    group.lenslet[group.n++] = k;
    if (group.n == lanes) measure();
  }
  if (group.n > 0) measure();
}

}  // namespace
}  // namespace curlew::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace curlew {

HWY_EXPORT(find);

void find_positions(const CentroidPlan& plan, FrameView frame, int first, int last,
                    Centroids& centroids, const FrameConditions& conditions) noexcept {
  HWY_DYNAMIC_DISPATCH(find)(plan, frame, first, last, conditions, centroids);
}

}  // namespace curlew
#endif  // HWY_ONCE
