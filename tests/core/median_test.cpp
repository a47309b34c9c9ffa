#include "core/median.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>
#include <vector>

namespace curlew {
namespace {

TEST(Median, IsTheMiddleValueOrTheMeanOfTheMiddleTwo) {
  std::vector<float> odd{5.0F, 1.0F, 4.0F};
  EXPECT_EQ(median_of(std::span(odd)), 4.0F);
  std::vector<float> even{5.0F, 1.0F, 4.0F, 2.0F};
  EXPECT_EQ(median_of(std::span(even)), 3.0F);
  EXPECT_TRUE(std::isnan(median_of(std::span<float>())));
  EXPECT_TRUE(std::isnan(median_of_magnitudes({})));
}

TEST(Median, OfMagnitudesIsTheSame) {
  std::mt19937_64 random(1);
  std::normal_distribution<float> normal(0.0F, 3.0F);
  for (const std::size_t n : {1U, 2U, 255U, 256U, 257U, 1000U, 2048U, 2049U}) {
    for (const float coarse : {0.0F, 0.25F, 1.0F, 100.0F}) {  // With 100, nearly all are 0.
      std::vector<float> values(n);
      for (float& value : values) {
        value = std::abs(normal(random));
        if (coarse > 0.0F) value = coarse * std::floor(value / coarse);
      }
      if (n > 2) values[1] = std::numeric_limits<float>::infinity();
      std::vector<float> again = values;
      EXPECT_EQ(median_of_magnitudes(again), median_of(std::span(values))) << n << ' ' << coarse;
    }
  }
}

TEST(Median, OfMagnitudesWithHalvesFarApart) {
  // The middle two lie in different bins.
  for (const std::size_t n : {256U, 300U}) {
    std::vector<float> values(n);
    for (std::size_t i = 0; i < n; ++i)
      values[i] = i % 2 == 0 ? 1.0F + 0.0001F * static_cast<float>(i) : 1000.0F;
    std::vector<float> again = values;
    EXPECT_EQ(median_of_magnitudes(again), median_of(std::span(values)));
  }
}

}  // namespace
}  // namespace curlew
