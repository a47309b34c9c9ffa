#include "service/bench/centroid_benchmark.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <limits>
#include <numeric>
#include <vector>

#include "centroiding/centroid.h"
#include "service/bench/plain_loops.h"

namespace curlew {
namespace {

std::vector<PlainBuild> builds_that_run() {
  std::vector<PlainBuild> builds;
  for (const PlainBuild build : kPlainBuilds)
    if (can_run(build)) builds.push_back(build);
  return builds;
}

/// Holds one case's plain centroids, by every build and in both orders, against the kernel's.
template <typename Pixel>
void expect_the_kernels_centroids(const BenchCase& which, PixelType pixel_type) {
  const FrameFormat format = bench_format(which, pixel_type);
  const AlignedVector<std::byte> pixels =
      bench_pixels(make_bench_frame(which, BenchSlopes::kRandom, 5), format);
  Sensor sensor = tiled_sensor(which);
  add_maps(sensor, 6);
  const CentroidPlan plan(sensor, format, {.threshold_adu = kBenchThresholdAdu});
  const FrameView view{pixels.data(), format.rows, format.cols, pixel_type};
  Centroids kernel(which.rows, which.cols);
  find_centroids(plan, view, kernel);
  ASSERT_GT(kernel.n_valid, which.rows * which.cols / 2);

  const PlainMaps maps(sensor, format, kBenchThresholdAdu);
  const PlainFrame<Pixel> frame{which.rows,         which.cols,       which.window_px,
                                view.data<Pixel>(), maps.gain.data(), maps.offset.data()};
  Image<float> x(which.rows, which.cols);
  Image<float> y(x);
  Image<float> flux(x);
  Image<float> column_sum(2, format.cols);
  for (const PlainBuild build : builds_that_run()) {
    for (const PlainOrder order : {PlainOrder::kWindows, PlainOrder::kRows}) {
      SCOPED_TRACE(name_of(build));
      for (Image<float>* map : {&x, &y, &flux, &column_sum}) map->fill(-1.0F);
      find_plain_centroids(build, order, frame,
                           {x.data(), y.data(), flux.data(), column_sum.data()});
      for (std::size_t k = 0; k < x.size(); ++k) {
        if (kernel.state[k] != LensletState::kValid) continue;
        // The kernel's maps are in codes, whose rounding is at most an eighth of the noise.
        EXPECT_NEAR(x[k], kernel.x_px[k], 4e-3) << k;
        EXPECT_NEAR(y[k], kernel.y_px[k], 4e-3) << k;
        const double adu = static_cast<double>(flux[k]) * format.scale_adu;
        EXPECT_NEAR(adu / static_cast<double>(kernel.flux_adu[k]), 1.0, 6e-3) << k;
      }
    }
  }
}

TEST(PlainCentroid, AgreesWithTheKernel) {
  for (const BenchCase& which :
       {BenchCase{5, 9, 6}, BenchCase{9, 5, 8}, BenchCase{7, 8, 10}, BenchCase{4, 3, 12},
        BenchCase{3, 4, 16}, BenchCase{3, 4, 32}, BenchCase{6, 5, 7}, BenchCase{2, 3, 33}}) {
    SCOPED_TRACE(std::to_string(which.window_px) + " px");
    expect_the_kernels_centroids<std::uint16_t>(which, PixelType::kU16);
    expect_the_kernels_centroids<std::uint8_t>(which, PixelType::kU8);
  }
}

TEST(PlainCentroid, AWindowWithoutLight) {
  const std::vector<std::uint16_t> pixels(2 * 8 * 8, 0);
  const std::vector<float> gain(pixels.size(), 1.0F);
  const std::vector<float> offset(pixels.size(), 10.0F);
  for (const PlainOrder order : {PlainOrder::kWindows, PlainOrder::kRows}) {
    std::vector<float> x(2), y(2), flux(2), column_sum(2 * 16);
    find_plain_centroids<std::uint16_t>(PlainBuild::kPortable, order,
                                        {1, 2, 8, pixels.data(), gain.data(), offset.data()},
                                        {x.data(), y.data(), flux.data(), column_sum.data()});
    EXPECT_EQ(x, (std::vector<float>{0.0F, 8.0F}));
    EXPECT_EQ(y, (std::vector<float>{0.0F, 0.0F}));
    EXPECT_EQ(flux, (std::vector<float>{0.0F, 0.0F}));
  }
}

template <typename Pixel>
void expect_exact_sums() {
  for (const std::size_t n : {0U, 1U, 7U, 64U, 1031U, 400003U}) {
    std::vector<Pixel> brightest(n, std::numeric_limits<Pixel>::max());
    std::vector<Pixel> counting(n);
    std::iota(counting.begin(), counting.end(), Pixel{1});
    for (const auto& pixels : {brightest, counting}) {
      const std::uint64_t sum = std::accumulate(pixels.begin(), pixels.end(), std::uint64_t{0});
      for (const PlainBuild build : builds_that_run())
        EXPECT_EQ(sum_pixels(build, pixels.data(), static_cast<std::int64_t>(n)), sum)
            << n << ' ' << name_of(build);
    }
  }
}

TEST(PlainCentroid, SumsOfPixelsAreExact) {
  expect_exact_sums<std::uint8_t>();
  expect_exact_sums<std::uint16_t>();
}

TEST(CentroidBenchmark, NamesWhatItTimed) {
  const CentroidBenchmark result = time_centroids({4, 5, 6}, PixelType::kU8, 1);
  EXPECT_EQ(result.frame_bytes, 4U * 5U * 36U);
  EXPECT_GE(result.cold_frames, 2);
  EXPECT_TRUE(can_run(result.windows_build));
  EXPECT_TRUE(can_run(result.rows_build));
  for (const CentroidTimes& times : {result.warm, result.cold})
    for (const RoundTimes& t :
         {times.curlew, times.following, times.kernel, times.kernel_by_windows, times.kernel_tilted,
          times.kernel_without_maps, times.plain_windows, times.plain_rows, times.read})
      EXPECT_GT(t.median_us, 0.0);
}

TEST(CentroidBenchmark, MethodsThatTakeTheWindow) {
  EXPECT_EQ(time_centroid_methods({2, 2, 8}, 1).size(), kCentroidMethodNames.size());
  const std::vector<CentroidMethodTimes> wide = time_centroid_methods({2, 2, 60}, 1);
  ASSERT_EQ(wide.size(), 2U);
  EXPECT_EQ(wide[0].method, "thresholded");
  EXPECT_EQ(wide[1].method, "plain");
}

}  // namespace
}  // namespace curlew
