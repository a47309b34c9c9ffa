#include "acquisition/simulator/random_stream.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace curlew {
namespace {

constexpr std::uint64_t kStreamSeed = 20070;

TEST(RandomStream, SamePairSameNumbersOtherPairOthers) {
  RandomStream a(1, 7);
  RandomStream b(1, 7);
  RandomStream other_stream(1, 8);
  RandomStream other_seed(2, 7);
  int equal = 0;
  for (int i = 0; i < 1000; ++i) {
    const std::uint64_t value = a.bits();
    ASSERT_EQ(value, b.bits());
    equal += value == other_stream.bits() ? 1 : 0;
    equal += value == other_seed.bits() ? 1 : 0;
  }
  EXPECT_EQ(equal, 0);
}

// Successive frames draw from neighbouring streams, whose first numbers must not correlate. The
// bound is 5 standard deviations of the mean of 100,000 products of variance 1/144.
TEST(RandomStream, SuccessiveStreamsAreUncorrelated) {
  SCOPED_TRACE(::testing::Message() << "seed " << kStreamSeed);
  constexpr int kStreams = 100'000;
  double product = 0.0;
  double previous = RandomStream(kStreamSeed, 0).uniform() - 0.5;
  for (int s = 1; s <= kStreams; ++s) {
    const double value = RandomStream(kStreamSeed, static_cast<std::uint64_t>(s)).uniform() - 0.5;
    product += value * previous;
    previous = value;
  }
  EXPECT_NEAR(product / kStreams, 0.0, 5.0 / 12.0 / std::sqrt(kStreams));
}

// Every bound is 5 standard deviations of what is estimated.
TEST(RandomStream, PoissonMeanAndVariance) {
  SCOPED_TRACE(::testing::Message() << "seed " << kStreamSeed);
  constexpr int kDraws = 200'000;
  for (const double mean : {0.01, 0.5, 5.0, 11.99, 12.01, 40.0, 1000.0, 1e6}) {
    RandomStream random(kStreamSeed, 1);
    double sum = 0.0;
    double squares = 0.0;
    for (int i = 0; i < kDraws; ++i) {
      const double off = random.poisson(mean) - mean;
      sum += off;
      squares += off * off;
    }
    EXPECT_NEAR(sum / kDraws, 0.0, 5.0 * std::sqrt(mean / kDraws)) << mean;
    // The fourth central moment is μ + 3μ², so the variance of off² is μ + 2μ².
    EXPECT_NEAR(squares / kDraws, mean, 5.0 * std::sqrt((mean + 2.0 * mean * mean) / kDraws))
        << mean;
  }
}

// This takes χ² of the frequencies against the distribution, on both sides of the change of method.
// Classes are pooled below 20 expected counts; the bound is 5 standard deviations of χ² above its
// mean.
TEST(RandomStream, PoissonFrequencies) {
  SCOPED_TRACE(::testing::Message() << "seed " << kStreamSeed);
  constexpr int kDraws = 400'000;
  for (const double mean : {3.0, 11.9, 12.1, 35.0, 150.0}) {
    RandomStream random(kStreamSeed, 2);
    std::vector<double> counts(1000, 0.0);
    for (int i = 0; i < kDraws; ++i) {
      counts[static_cast<std::size_t>(std::min(random.poisson(mean), 999.0))] += 1.0;
    }
    double chi2 = 0.0;
    int classes = 0;
    double rest_expected = kDraws;
    double rest_counted = kDraws;
    for (std::size_t k = 0; k < counts.size(); ++k) {
      const auto value = static_cast<double>(k);
      const double expected =
          kDraws * std::exp(value * std::log(mean) - mean - std::lgamma(value + 1.0));
      if (expected < 20.0) continue;
      chi2 += (counts[k] - expected) * (counts[k] - expected) / expected;
      ++classes;
      rest_expected -= expected;
      rest_counted -= counts[k];
    }
    chi2 += (rest_counted - rest_expected) * (rest_counted - rest_expected) / rest_expected;
    EXPECT_LT(chi2, classes + 5.0 * std::sqrt(2.0 * classes)) << mean;
    EXPECT_GT(classes, 5);
  }
}

TEST(RandomStream, PoissonOfNothingIsNothing) {
  RandomStream random(kStreamSeed, 3);
  EXPECT_EQ(random.poisson(0.0), 0.0);
  EXPECT_EQ(random.poisson(-1.0), 0.0);
  EXPECT_EQ(random.poisson(std::nan("")), 0.0);
}

// The moments and the fraction beyond several limits (3.8 lies in the ziggurat's tail) must each be
// right within 5 standard deviations.
TEST(RandomStream, GaussianMomentsAndTails) {
  SCOPED_TRACE(::testing::Message() << "seed " << kStreamSeed);
  constexpr int kDraws = 2'000'000;
  RandomStream random(kStreamSeed, 4);
  double sum = 0.0;
  double squares = 0.0;
  double fourths = 0.0;
  const double limits[] = {0.1, 1.0, 2.0, 3.0, 3.8};
  double beyond[] = {0.0, 0.0, 0.0, 0.0, 0.0};
  for (int i = 0; i < kDraws; ++i) {
    const double x = random.gaussian();
    sum += x;
    squares += x * x;
    fourths += x * x * x * x;
    for (int k = 0; k < 5; ++k) beyond[k] += std::abs(x) > limits[k] ? 1.0 : 0.0;
  }
  EXPECT_NEAR(sum / kDraws, 0.0, 5.0 / std::sqrt(kDraws));
  EXPECT_NEAR(squares / kDraws, 1.0, 5.0 * std::sqrt(2.0 / kDraws));
  EXPECT_NEAR(fourths / kDraws, 3.0, 5.0 * std::sqrt(96.0 / kDraws));
  for (int k = 0; k < 5; ++k) {
    const double p = std::erfc(limits[k] / std::numbers::sqrt2);
    EXPECT_NEAR(beyond[k] / kDraws, p, 5.0 * std::sqrt(p / kDraws)) << limits[k];
  }
}

}  // namespace
}  // namespace curlew
