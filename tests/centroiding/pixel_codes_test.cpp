// Coded gains and offsets are as close as they say, and are not used where that is too far.
#include "centroiding/pixel_codes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <string>

#include "centroiding/centroid.h"
#include "service/bench/bench_frames.h"

namespace curlew {
namespace {

constexpr BenchCase kCase{8, 8, 10};
constexpr CodeTolerance kLoose{.gain = 1.0, .offset = 1.0, .brightest = 4095.0};

struct Maps {
  Image<float> gain{20, 30};
  Image<float> offset{20, 30};
};

Maps random_maps() {
  Maps maps;
  std::mt19937_64 random(1);
  std::normal_distribution<float> normal;
  for (std::size_t i = 0; i < maps.gain.size(); ++i) {
    maps.gain[i] = i % 50 == 7 ? 0.0F : 1.0F + 0.02F * normal(random);
    maps.offset[i] = i % 50 == 7 ? 9e9F : 120.0F + 3.0F * normal(random);
  }
  return maps;
}

TEST(PixelCodes, AreWithinHalfAStep) {
  const Maps exact = random_maps();
  Maps coded = exact;
  PixelCodes codes;
  ASSERT_TRUE(code_maps(coded.gain, coded.offset, kLoose, codes));
  for (std::size_t i = 0; i < exact.gain.size(); ++i) {
    if (!(exact.gain[i] > 0.0F)) {
      EXPECT_EQ(codes.gain[i], 0);
      EXPECT_EQ(coded.gain[i], 0.0F);
      continue;
    }
    EXPECT_GT(codes.gain[i], 0);
    // Besides half a step there is the rounding of floats.
    EXPECT_NEAR(coded.gain[i], exact.gain[i], 0.5F * codes.gain_step + 1e-6F);
    EXPECT_NEAR(coded.offset[i], exact.offset[i], 0.5F * codes.offset_step + 2e-5F);
  }
}

TEST(PixelWords, AreWithinHalfAStep) {
  const Maps exact = random_maps();
  for (const double tolerance : {1.0, 0.1}) {
    Maps coded = exact;
    PixelWords words;
    ASSERT_TRUE(code_in_words(coded.gain, coded.offset,
                              {.gain = 1.0, .offset = tolerance, .brightest = 4095.0}, words));
    EXPECT_LE(0.5F * words.unit, static_cast<float>(tolerance));
    for (std::size_t i = 0; i < exact.gain.size(); ++i) {
      if (!(exact.gain[i] > 0.0F)) {
        EXPECT_EQ(words.words[i], PixelWords::kBadWord);
        continue;
      }
      EXPECT_NE(words.words[i], PixelWords::kBadWord);
      EXPECT_NEAR(coded.gain[i], exact.gain[i], 0.51F * 1.1F * 64.0F / 65536.0F);
      EXPECT_NEAR(coded.offset[i], exact.offset[i], 0.5F * words.unit + 2e-5F);
    }
  }
}

/// The formula of PixelWords says what the decoded maps say, to a unit.
TEST(PixelWords, MeanWhatTheMapsSay) {
  Maps maps = random_maps();
  PixelWords words;
  ASSERT_TRUE(code_in_words(maps.gain, maps.offset, kLoose, words));
  for (std::size_t i = 0; i < maps.gain.size(); ++i) {
    if (!(maps.gain[i] > 0.0F)) continue;
    for (const int count : {150, 1000, 4095}) {
      const int c = count * words.count_scale;
      const int h = (words.words[i] >> PixelWords::kGainShift) & words.gain_mask;
      const int whole = c - c * h / 65536 - (words.words[i] & 0xFF);
      const float signal = static_cast<float>(whole) * words.unit - words.offset_base;
      EXPECT_NEAR(signal, maps.gain[i] * static_cast<float>(count) - maps.offset[i],
                  0.51F * words.unit + 1e-3F);
    }
  }
}

TEST(PixelWords, GainsThatAreAlikeAreExact) {
  Maps maps{Image<float>(4, 4, 1.0F), Image<float>(4, 4, 130.25F)};
  maps.offset(1, 1) = 140.25F;
  PixelWords words;
  ASSERT_TRUE(code_in_words(maps.gain, maps.offset, kLoose, words));
  EXPECT_EQ(maps.gain(2, 3), 1.0F);
  EXPECT_EQ(maps.offset(2, 3), 130.25F);
  EXPECT_EQ(maps.offset(1, 1), 140.25F);
}

/// The noise is 3 counts, and an eighth of it may be wrong.
TEST(PixelCodes, AreChosenByWhatIsTooCoarse) {
  Sensor sensor = tiled_sensor(kCase);
  add_maps(sensor, 1);
  const FrameFormat format = bench_format(kCase, PixelType::kU16);
  const auto chosen = [&] {
    const CentroidPlan plan(sensor, format, {});
    return std::string(plan.words.empty() ? "" : "words ") + (plan.codes.empty() ? "" : "codes");
  };
  EXPECT_EQ(chosen(), "words codes");  // Counts above 32767 do not fit into the words.
  sensor.detector.saturation_adu = 16383.0;
  EXPECT_EQ(chosen(), "words ");
  sensor.dark_adu(3, 4) = 2000.0F;  // A byte does not reach from the other pixels to a hot one.
  EXPECT_EQ(chosen(), "codes");
  sensor.bad_pixel(3, 4) = 1;
  EXPECT_EQ(chosen(), "words ");
  sensor.flat(5, 4) = 0.5F;
  EXPECT_EQ(chosen(), "codes");
  sensor.dark_adu(5, 4) = 1e6F;  // Steps of 32 counts are too coarse.
  EXPECT_EQ(chosen(), "");
}

}  // namespace
}  // namespace curlew
