#include "acquisition/simulator/field_vortices.h"

#include <gtest/gtest.h>

#include <cmath>
#include <complex>
#include <numbers>
#include <vector>

#include "acquisition/simulator/random_stream.h"
#include "tests/support/constants.h"

namespace curlew {
namespace {

using Complex = std::complex<double>;

// Samples a function of lenslet units over rows × cols lenslets and a margin round them.
template <typename Function>
SampledField sample_field(int rows, int cols, int n, Function value, int margin = 0) {
  SampledField field;
  field.samples_per_lenslet = n;
  field.margin_lenslets = margin;
  field.values = Image<std::complex<float>>((rows + 2 * margin) * n, (cols + 2 * margin) * n);
  for (int i = 0; i < field.values.rows(); ++i) {
    for (int j = 0; j < field.values.cols(); ++j) {
      field.values(i, j) =
          std::complex<float>(value((j + 0.5) / n - 0.5 - margin, (i + 0.5) / n - 0.5 - margin));
    }
  }
  return field;
}

TEST(FieldVortices, LinearCoreIsPlacedToAThousandthOfASample) {
  RandomStream random(21, 0);
  for (int trial = 0; trial < 200; ++trial) {
    const double x0 = 1.0 + 3.0 * random.uniform();
    const double y0 = 1.0 + 3.0 * random.uniform();
    const double alpha = 1.2 * random.uniform();
    const double beta = 2.0 * kPi * random.uniform();
    const int charge = trial % 2 == 0 ? 1 : -1;
    SCOPED_TRACE(::testing::Message() << "seed 21, vortex at " << x0 << ", " << y0);
    const SampledField field = sample_field(6, 6, 8, [&](double x, double y) {
      const Complex z(x - x0, y - y0);
      const Complex u = std::polar(std::cos(alpha / 2), beta / 2) * z +
                        std::polar(std::sin(alpha / 2), -beta / 2) * std::conj(z);
      return charge > 0 ? u : std::conj(u);
    });
    const std::vector<SceneVortex> found = find_field_vortices(field);
    ASSERT_EQ(found.size(), 1U);
    EXPECT_NEAR(found[0].x, x0, 1e-3 / 8);
    EXPECT_NEAR(found[0].y, y0, 1e-3 / 8);
    EXPECT_EQ(found[0].charge, charge);
  }
}

TEST(FieldVortices, MarginIsCountedBeyondTheArray) {
  const auto value = [](double x, double y) { return Complex(x + 1.3, y - 2.7); };
  const std::vector<SceneVortex> found = find_field_vortices(sample_field(4, 4, 8, value, 2));
  ASSERT_EQ(found.size(), 1U);
  EXPECT_NEAR(found[0].x, -1.3, 1e-4);
  EXPECT_NEAR(found[0].y, 2.7, 1e-4);
  EXPECT_TRUE(find_field_vortices(sample_field(4, 4, 8, value)).empty());
}

// The field has two vortices of linear amplitude. One alone would be bilinear, and the other bends
// it a little.
TEST(FieldVortices, TwoBendEachOtherByWhatTheoryAllows) {
  const std::vector<SceneVortex> found =
      find_field_vortices(sample_field(4, 4, 8, [](double x, double y) {
        return Complex(x - 1.23, y - 0.41) * std::conj(Complex(x - 2.5, y - 2.6));
      }));
  ASSERT_EQ(found.size(), 2U);
  // The product's second derivatives are 2 along x and y, so interpolation over h = 1/8 is off by
  // 2·2·h²/8 = .0078. The field's gradient is the other factor, 2.5, so the place is off by .0031
  // pitches.
  EXPECT_NEAR(found[0].x, 1.23, 3.2e-3);
  EXPECT_NEAR(found[0].y, 0.41, 3.2e-3);
  EXPECT_EQ(found[0].charge, 1);
  EXPECT_NEAR(found[1].x, 2.5, 3.2e-3);
  EXPECT_NEAR(found[1].y, 2.6, 3.2e-3);
  EXPECT_EQ(found[1].charge, -1);
}

// The plaquette's winding must be the sum of its edges' principal phase differences.
TEST(FieldVortices, WindingIsThatOfThePhaseDifferences) {
  RandomStream random(22, 0);
  int with_vortex = 0;
  for (int trial = 0; trial < 20'000; ++trial) {
    const SampledField field = sample_field(
        1, 1, 2, [&](double, double) { return Complex(random.gaussian(), random.gaussian()); });
    const auto& v = field.values;
    double sum = 0.0;
    const std::array<Complex, 5> round{v(0, 0), v(0, 1), v(1, 1), v(1, 0), v(0, 0)};
    for (std::size_t c = 0; c < 4; ++c) sum += std::arg(round[c + 1] * std::conj(round[c]));
    const int turns = static_cast<int>(std::lround(sum / (2.0 * kPi)));
    const std::vector<SceneVortex> found = find_field_vortices(field);
    ASSERT_EQ(found.size(), turns == 0 ? 0U : 1U) << "seed 22, trial " << trial;
    if (turns == 0) continue;
    ++with_vortex;
    EXPECT_EQ(found[0].charge, turns);
    EXPECT_TRUE(found[0].x >= -0.26 && found[0].x <= 0.26);
    EXPECT_TRUE(found[0].y >= -0.26 && found[0].y <= 0.26);
  }
  EXPECT_GT(with_vortex, 5000);  // Of all sets of four independent phases a third wind.
}

TEST(FieldVortices, NoneInTiltedOrDarkOrCurvedLight) {
  EXPECT_TRUE(find_field_vortices(sample_field(4, 4, 8, [](double x, double y) {
                return std::polar(1.0, 9.0 * x - 5.0 * y);
              })).empty());
  EXPECT_TRUE(find_field_vortices(sample_field(4, 4, 8, [](double x, double y) {
                return std::polar(std::exp(-x * x - y * y), 3.0 * (x * x + y * y));
              })).empty());
  EXPECT_TRUE(
      find_field_vortices(sample_field(4, 4, 8, [](double, double) { return Complex(); })).empty());
}

}  // namespace
}  // namespace curlew
