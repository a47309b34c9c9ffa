#include "centroiding/window_light.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "centroiding/centroid.h"
#include "centroiding/frame_level.h"

namespace curlew {
namespace {

struct WindowSum {
  double counts = 0.0;  ///< above the calibration's dark
  double good_px = 0.0;
  double area_px = 0.0;
};

/// Adds the `n` pixels of a row that begins at `first`.
template <typename Pixel>
void add_row(const CentroidPlan& plan, const Pixel* pixels, std::size_t first, std::size_t n,
             WindowSum& sum) {
  const auto size = static_cast<double>(n);
  if (plan.gain.empty()) {
    std::uint32_t counts = 0;
    for (std::size_t i = first; i < first + n; ++i) counts += pixels[i];
    sum.counts += static_cast<double>(counts) - size * static_cast<double>(plan.uniform_offset);
    sum.good_px += size;
  } else {
    float counts = 0.0F;
    float good = 0.0F;
    for (std::size_t i = first; i < first + n; ++i) {
      const bool is_good = plan.gain[i] > 0.0F;
      counts += is_good ? plan.gain[i] * static_cast<float>(pixels[i]) - plan.offset[i] : 0.0F;
      good += is_good ? 1.0F : 0.0F;
    }
    sum.counts += static_cast<double>(counts);
    sum.good_px += static_cast<double>(good);
  }
}

template <typename Pixel>
WindowSum sum_window(const CentroidPlan& plan, FrameView frame, const WindowSpot& spot, int moved_x,
                     int moved_y) {
  const int first_x = std::clamp(spot.x0 + moved_x, 0, frame.cols);
  const int first_y = std::clamp(spot.y0 + moved_y, 0, frame.rows);
  const int end_x = std::clamp(spot.x0 + moved_x + spot.w, first_x, frame.cols);
  const int end_y = std::clamp(spot.y0 + moved_y + spot.h, first_y, frame.rows);
  WindowSum sum;
  sum.area_px = static_cast<double>(end_x - first_x) * (end_y - first_y);
  for (int y = first_y; y < end_y; ++y)
    add_row(plan, frame.data<Pixel>(),
            static_cast<std::size_t>(y) * static_cast<std::size_t>(frame.cols) +
                static_cast<std::size_t>(first_x),
            static_cast<std::size_t>(end_x - first_x), sum);
  sum.counts += sum.good_px * static_cast<double>(plan.threshold);  // the offsets hold it, too
  return sum;
}

}  // namespace

void sum_window_light(const CentroidPlan& plan, FrameView frame, const Centroids& centroids,
                      const FrameLevels* levels, Image<float>& light_adu,
                      Image<float>& area_px) noexcept {
  const auto adu_per_count = static_cast<double>(plan.adu_per_count);
  const auto threshold = static_cast<double>(levels ? levels->threshold : plan.threshold);
  for (std::size_t k = 0; k < plan.spots.size(); ++k) {
    light_adu[k] = area_px[k] = 0.0F;
    const WindowSpot& spot = plan.spots[k];
    if (spot.state != LensletState::kValid) continue;
    const auto moved_x = static_cast<int>(centroids.moved_x_px[k]);
    const auto moved_y = static_cast<int>(centroids.moved_y_px[k]);
    const WindowSum sum = frame.pixel_type == PixelType::kU8
                              ? sum_window<std::uint8_t>(plan, frame, spot, moved_x, moved_y)
                              : sum_window<std::uint16_t>(plan, frame, spot, moved_x, moved_y);
    if (sum.good_px == 0.0) continue;
    const double level = levels ? static_cast<double>(levels->level[k]) : 0.0;
    const double counts = sum.counts - sum.good_px * level;
    // What is above the threshold is the flux, so that the rest is no more than this a pixel. The
    // reckoning of both is rounded.
    const double flux = static_cast<double>(centroids.flux_adu[k]) / adu_per_count;
    const double most = 1.001 * (flux + sum.good_px * threshold) + 1.0;
    if (plan.relative_threshold == 0.0F && counts > most) continue;
    light_adu[k] = static_cast<float>(counts * sum.area_px / sum.good_px * adu_per_count);
    area_px[k] = static_cast<float>(sum.area_px);
  }
}

}  // namespace curlew
