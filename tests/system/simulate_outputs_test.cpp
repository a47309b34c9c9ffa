// What `simulate` writes beside the frames: a dark, the true fields, and times by the frame rate.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "acquisition/fits/fits_file.h"
#include "tests/support/program.h"

namespace curlew {
namespace {

const std::string kSensor = "--rows 6 --cols 5 --window 8 --photons 2000 --read-noise 3 ";

std::vector<double> pixels_of(const std::string& path) {
  FitsFile file = FitsFile::open(path);
  std::vector<double> pixels(static_cast<std::size_t>(file.image().elements()));
  file.read_pixels<double>(0, pixels);
  return pixels;
}

TEST(SimulateOutputs, FramesHaveTheirRateAndADark) {
  const ScratchDirectory scratch;
  const ProgramRun run = run_curlew(scratch, "simulate --preset plane " + kSensor +
                                                 "--frames 3 --frame-rate 250 --background 40 "
                                                 "--dark dark.fits --dark-frames 4 --out f.fits");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  FitsFile file = FitsFile::open(scratch / "f.fits");
  file.select("FRAMES");
  std::vector<std::int64_t> times(3);
  file.read_column<std::int64_t>("CAMERA_NS", 0, times);
  EXPECT_EQ(times, (std::vector<std::int64_t>{0, 4'000'000, 8'000'000}));
  const std::vector<double> dark = pixels_of(scratch / "dark.fits");
  ASSERT_EQ(dark.size(), 4U * 48U * 40U);
  double mean = 0.0, square = 0.0;
  for (const double adu : dark) mean += adu / static_cast<double>(dark.size());
  for (const double adu : dark)
    square += (adu - mean) * (adu - mean) / static_cast<double>(dark.size());
  // 7680 pixels of 3 ADU rms, rounded to whole ones, about the bias of 100: neither sky nor spots.
  EXPECT_NEAR(mean, 100.0, 0.2);
  EXPECT_NEAR(std::sqrt(square), 3.0, 0.15);
}

TEST(SimulateOutputs, EveryFrameHasItsField) {
  const ScratchDirectory scratch;
  const ProgramRun run = run_curlew(
      scratch, "simulate --preset turbulence --r0 2.5 " + kSensor +
                   "--frames 2 --field-out first.fits --fields-out fields.fits --out f.fits");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_NE(run.out.find("r0 2.5 pitches"), std::string::npos) << run.out;
  const std::vector<double> first = pixels_of(scratch / "first.fits");
  const std::vector<double> all = pixels_of(scratch / "fields.fits");
  ASSERT_EQ(all.size(), 2 * first.size());
  const auto second = all.begin() + static_cast<std::ptrdiff_t>(first.size());
  EXPECT_TRUE(std::equal(first.begin(), first.end(), all.begin()));
  EXPECT_FALSE(std::equal(first.begin(), first.end(), second));  // without wind another realisation
  EXPECT_TRUE(std::all_of(all.begin(), all.end(), [](double v) { return std::isfinite(v); }));
}

TEST(SimulateOutputs, WhatMakesNoSenseIsRefused) {
  const ScratchDirectory scratch;
  const auto refused = [&](const std::string& more, const std::string& words) {
    const ProgramRun run = run_curlew(scratch, "simulate --out f.fits " + more);
    EXPECT_EQ(run.exit_code, 2) << more;
    EXPECT_NE(run.err.find(words), std::string::npos) << run.err;
  };
  refused("--preset turbulence --r0 2 --rytov-variance 1", "give one of them");
  refused("--r0 2", "--preset turbulence");
  refused("--photons 0 --dark d.fits", "state --photons");
  refused("--dark f.fits", "name the same file");
  refused("--frame-rate 0", "--frame-rate");
}

}  // namespace
}  // namespace curlew
