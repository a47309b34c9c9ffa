#include "service/sensor/reference_spots.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <vector>

#include "centroiding/frame_level.h"
#include "centroiding/sharp_pixels.h"
#include "core/error.h"
#include "core/median.h"
#include "service/program/interrupt.h"
#include "service/program/progress.h"

namespace curlew {
namespace {

constexpr std::array<const char*, kLensletStates> kReasons = {"",
                                                              "unlit",
                                                              "too faint",
                                                              "saturated",
                                                              "at their window's edge",
                                                              "on bad pixels",
                                                              "without a spot of their own"};

struct Sums {
  double x = 0.0;
  double y = 0.0;
  double flux = 0.0;
  double variance_px2 = 0.0;  ///< of the spot, along an axis
  std::array<int, kLensletStates> states{};
};

void add_to(std::vector<Sums>& sums, const Centroids& centroids) {
  for (std::size_t k = 0; k < sums.size(); ++k) {
    ++sums[k].states[static_cast<std::size_t>(centroids.state[k])];
    if (centroids.state[k] != LensletState::kValid) continue;
    sums[k].x += static_cast<double>(centroids.x_px[k]);
    sums[k].y += static_cast<double>(centroids.y_px[k]);
    sums[k].flux += static_cast<double>(centroids.flux_adu[k]);
    sums[k].variance_px2 += 0.5 * static_cast<double>(centroids.xx_px2[k] + centroids.yy_px2[k]);
  }
}

}  // namespace

ReferenceReport measure_reference_spots(FrameSource& source, const CentroidOptions& options,
                                        Sensor& sensor) {
  const CentroidPlan plan(sensor, source.format(), options);
  const LevelPlan level_plan(sensor, plan, options);
  FrameLevels levels(level_plan);
  const SharpPixelPlan sharp_plan(sensor, source.format());
  SharpPixels sharp(sensor.valid.rows(), sensor.valid.cols());
  FrameBuffer frame(source.format());
  Centroids centroids(sensor.grid.rows, sensor.grid.cols);
  std::vector<Sums> sums(sensor.valid.size());
  int frames = 0;
  Progress progress("calibrate", source.frame_count());
  while (!interrupted() && source.next(frame) == Delivery::kFrame) {
    if (options.follow_level) {
      measure_levels(level_plan, level_plan.pixels(), frame.view(), levels);
      find_sharp_pixels(sharp_plan, plan, plan.spots, frame.view(), levels, sharp);
    }
    const FrameConditions conditions =
        options.follow_level ? FrameConditions{&levels, &sharp} : FrameConditions{};
    find_centroids(plan, frame.view(), centroids, conditions);
    find_core_positions(plan, frame.view(), centroids, conditions);
    ++frames;
    progress.step();
    add_to(sums, centroids);
  }

  if (interrupted()) throw Failure("interrupted, no sensor file was written");
  ReferenceReport report;
  std::array<int, kLensletStates> reasons{};
  std::vector<double> sigmas_px;
  int left = 0;
  for (std::size_t k = 0; k < sums.size(); ++k) {
    if (sensor.valid[k] == 0) continue;
    const int n = sums[k].states[0];
    if (n > 0 && 2 * n >= frames) {
      ++left;
      sensor.ref_x_px[k] = static_cast<float>(sums[k].x / n);
      sensor.ref_y_px[k] = static_cast<float>(sums[k].y / n);
      sensor.flux_adu[k] = static_cast<float>(sums[k].flux / n);
      sigmas_px.push_back(std::sqrt(sums[k].variance_px2 / n));
      continue;
    }
    const auto& states = sums[k].states;
    const auto worst = std::max_element(states.begin() + 1, states.end()) - states.begin();
    ++reasons[static_cast<std::size_t>(worst)];
    ++report.dropped;
    drop_lenslet(sensor, k);
  }
  for (std::size_t i = 1; i < kLensletStates; ++i)
    if (reasons[i] > 0)
      report.text +=
          fmt::format("{}{} {}", report.text.empty() ? "" : ", ", reasons[i], kReasons[i]);
  if (left == 0)
    throw Failure(fmt::format(
        "no lenslet of the reference can be measured ({}): check exposure and thresholds",
        report.text));
  sensor.spot_sigma_px = median_of(std::span(sigmas_px));
  if (report.dropped > 0) report.text = "spots left out: " + report.text;
  return report;
}

double find_frame_threshold_adu(FrameSource& source, const CentroidOptions& options,
                                const Sensor& sensor) {
  constexpr std::size_t kFrames = 32;
  const CentroidPlan plan(sensor, source.format(), options);
  const LevelPlan level_plan(sensor, plan, options);
  FrameLevels levels(level_plan);
  FrameBuffer frame(source.format());
  std::vector<double> thresholds_adu;
  while (thresholds_adu.size() < kFrames && source.next(frame) == Delivery::kFrame) {
    measure_levels(level_plan, level_plan.pixels(), frame.view(), levels);
    levels.scratch = levels.level;
    const float level = median_of(std::span(levels.scratch.begin(), levels.scratch.end()));
    thresholds_adu.push_back(static_cast<double>(level + levels.threshold) *
                             source.format().scale_adu);
  }
  return thresholds_adu.empty() ? 0.0 : median_of(std::span(thresholds_adu));
}

}  // namespace curlew
