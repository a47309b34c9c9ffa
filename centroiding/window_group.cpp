#include "centroiding/window_group.h"

#include <algorithm>
#include <cstdint>

#include "centroiding/frame_level.h"
#include "centroiding/sharp_pixels.h"

namespace curlew {
namespace {

/// Clears a lenslet in which the method sees no light, even if the threshold let some pass.
void clear_spot(Centroids& out, std::size_t k, LensletState state) noexcept {
  out.x_px[k] = out.y_px[k] = out.flux_adu[k] = 0.0F;
  out.xx_px2[k] = out.yy_px2[k] = out.xy_px2[k] = 0.0F;
  out.variance_x_px2[k] = out.variance_y_px2[k] = out.covariance_xy_px2[k] = 0.0F;
  out.state[k] = state;
}

template <typename Pixel, bool kMaps>
void load(const CentroidPlan& plan, const Pixel* pixels, const WindowGroup& group,
          std::size_t lanes, const FrameConditions& conditions, float* light) noexcept {
  const FrameLevels* levels = conditions.levels;
  const SharpPixels* sharp = conditions.sharp;
  const float bad = plan.method == CentroidMethod::kMaximumLikelihood ? kBad : kNothing;
  for (std::size_t lane = 0; lane < lanes; ++lane) {
    const std::size_t k = group.lenslet[lane];
    const CentroidPlan::Spot& spot = windows_of(plan, conditions)[k];
    const float level = (levels != nullptr ? levels->level[k] : 0.0F) - plan.threshold;
    const float offset = plan.uniform_offset + level;
    const auto w = static_cast<std::size_t>(spot.w);
    const auto h = static_cast<std::size_t>(spot.h);
    for (std::size_t y = 0; y < group.h; ++y) {
      float* to = light + y * group.w * lanes + lane;
      std::size_t x = 0;
      if (y < h) {
        const std::size_t first =
            (static_cast<std::size_t>(spot.y0) + y) * static_cast<std::size_t>(plan.frame_cols) +
            static_cast<std::size_t>(spot.x0);
        for (; x < w; ++x) {
          const auto count = static_cast<float>(pixels[first + x]);
          if constexpr (kMaps) {
            const float gain = plan.gain[first + x];
            const float dark = plan.offset[first + x] + level;
            to[x * lanes] = gain > 0.0F ? gain * count - dark : bad;
          } else {
            to[x * lanes] = count - offset;
          }
        }
      }
      for (; x < group.w; ++x) to[x * lanes] = bad;
    }
    if (sharp == nullptr) continue;
    for (std::int32_t i = sharp->first[k]; i >= 0;
         i = sharp->pixels[static_cast<std::size_t>(i)].next) {
      const SharpPixel& pixel = sharp->pixels[static_cast<std::size_t>(i)];
      const auto y = static_cast<std::size_t>(pixel.y - spot.y0);
      const auto x = static_cast<std::size_t>(pixel.x - spot.x0);
      const float count = count_instead(pixels, plan.frame_cols, pixel);
      float& to = light[(y * group.w + x) * lanes + lane];
      if constexpr (kMaps) {
        to = plan.gain(pixel.y, pixel.x) * count - (plan.offset(pixel.y, pixel.x) + level);
      } else {
        to = count - offset;
      }
    }
  }
}

}  // namespace

void describe_windows(const CentroidPlan& plan, const FrameConditions& conditions,
                      const Centroids& found, std::size_t lanes, WindowGroup& group) noexcept {
  group.w = group.h = 0;
  for (std::size_t lane = 0; lane < lanes; ++lane) {
    const std::size_t k = group.lenslet[lane < group.n ? lane : 0];
    const CentroidPlan::Spot& spot = windows_of(plan, conditions)[k];
    group.lenslet[lane] = k;
    group.w = std::max(group.w, static_cast<std::size_t>(spot.w));
    group.h = std::max(group.h, static_cast<std::size_t>(spot.h));
    group.width[lane] = static_cast<float>(spot.w);
    group.height[lane] = static_cast<float>(spot.h);
    group.half_x[lane] = 0.5F * (group.width[lane] - 1.0F);
    group.half_y[lane] = 0.5F * (group.height[lane] - 1.0F);
    group.reference_x[lane] = plan.reference_x[k];
    group.reference_y[lane] = plan.reference_y[k];
    const bool known = found.state[k] == LensletState::kValid;
    group.start_x[lane] = known ? found.x_px[k] - (static_cast<float>(spot.x0) + group.half_x[lane])
                                : group.reference_x[lane];
    group.start_y[lane] = known ? found.y_px[k] - (static_cast<float>(spot.y0) + group.half_y[lane])
                                : group.reference_y[lane];
  }
}

void load_windows(const CentroidPlan& plan, FrameView frame, const WindowGroup& group,
                  std::size_t lanes, const FrameConditions& conditions, float* light) noexcept {
  const bool maps = !plan.gain.empty();
  if (frame.pixel_type == PixelType::kU16) {
    const auto* pixels = frame.data<std::uint16_t>();
    maps ? load<std::uint16_t, true>(plan, pixels, group, lanes, conditions, light)
         : load<std::uint16_t, false>(plan, pixels, group, lanes, conditions, light);
  } else {
    const auto* pixels = frame.data<std::uint8_t>();
    maps ? load<std::uint8_t, true>(plan, pixels, group, lanes, conditions, light)
         : load<std::uint8_t, false>(plan, pixels, group, lanes, conditions, light);
  }
}

void adopt_position(const CentroidPlan& plan, const FrameConditions& conditions,
                    const GroupPositions& found, std::size_t lane, std::size_t k,
                    Centroids& out) noexcept {
  const CentroidPlan::Spot& spot = windows_of(plan, conditions)[k];
  const bool was_valid = out.state[k] == LensletState::kValid;
  const float x = found.x[lane];
  const float y = found.y[lane];
  const float signal = found.signal[lane];
  LensletState state = LensletState::kValid;
  if (!(signal > 0.0F && signal * signal >= plan.min_snr_squared * found.signal_variance[lane])) {
    state = LensletState::kFaint;
  } else if (!(x >= spot.min_x && x <= spot.max_x && y >= spot.min_y && y <= spot.max_y)) {
    state = LensletState::kAtEdge;
  }
  if (!(signal > 0.0F)) return clear_spot(out, k, state);
  if (!(out.flux_adu[k] > 0.0F)) out.flux_adu[k] = found.flux[lane] * plan.adu_per_count;
  if (!was_valid) {
    out.xx_px2[k] = out.yy_px2[k] = plan.spot_sigma_px * plan.spot_sigma_px;
    out.xy_px2[k] = 0.0F;
  }
  out.x_px[k] = (static_cast<float>(spot.x0) + 0.5F * static_cast<float>(spot.w - 1)) + x;
  out.y_px[k] = (static_cast<float>(spot.y0) + 0.5F * static_cast<float>(spot.h - 1)) + y;
  const bool known = plan.counts_per_e > 0.0F;
  out.variance_x_px2[k] = known ? found.variance_x[lane] : 0.0F;
  out.variance_y_px2[k] = known ? found.variance_y[lane] : 0.0F;
  out.covariance_xy_px2[k] = known ? found.covariance[lane] : 0.0F;
  out.state[k] = state;
}

}  // namespace curlew
