#include "acquisition/simulator/lenslet_optics.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <string>

#include "acquisition/simulator/random_stream.h"
#include "core/error.h"
#include "tests/support/analytic_slopes.h"
#include "tests/support/constants.h"

namespace curlew {
namespace {

using Complex = std::complex<double>;

Image<Complex> plane_wave(int samples, double slope_x, double slope_y) {
  Image<Complex> field(samples, samples);
  for (int i = 0; i < samples; ++i) {
    for (int j = 0; j < samples; ++j) {
      field(i, j) = std::polar(1.0, (slope_x * (j + 0.5) + slope_y * (i + 0.5)) / samples);
    }
  }
  return field;
}

Image<double> far_field(const Image<Complex>& field, double pixels_per_lambda_w, int patch_px) {
  LensletOptics optics(field.rows(), pixels_per_lambda_w, patch_px);
  Image<double> patch(patch_px, patch_px);
  optics.propagate(field, patch);
  return patch;
}

double total(const Image<double>& patch) {
  return std::accumulate(patch.begin(), patch.end(), 0.0);
}

// Returns the centre of gravity along x, in pixels from the patch's centre.
double centroid_x(const Image<double>& patch) {
  double sum = 0.0;
  for (int i = 0; i < patch.rows(); ++i) {
    for (int j = 0; j < patch.cols(); ++j) sum += (j - 0.5 * (patch.cols() - 1)) * patch(i, j);
  }
  return sum / total(patch);
}

// Integrates |aperture(u)|² over a pixel, by Gauss points dense enough for 1e-14.
template <typename Aperture>
double integrate_pixel(const Aperture& aperture, double from, double to) {
  double sum = 0.0;
  constexpr int kParts = 8;
  for (int p = 0; p < kParts; ++p) {
    const double step = (to - from) / kParts;
    sum +=
        analytic_slopes::integrate_once<double>([&](double u) { return aperture(u) * aperture(u); },
                                                from + p * step, from + (p + 1) * step);
  }
  return sum;
}

TEST(LensletOptics, ParsevalForAnyField) {
  constexpr std::uint64_t kSeed = 5;
  SCOPED_TRACE(::testing::Message() << "seed " << kSeed);
  RandomStream random(kSeed, 0);
  for (const int samples : {8, 16, 31}) {
    Image<Complex> field(samples, samples);
    double power = 0.0;
    for (auto& value : field) {
      value = {random.gaussian(), random.gaussian()};
      power += std::norm(value) / static_cast<double>(field.size());
    }
    // The patch is the whole period of the far field, `samples` λ/w, here with 3 pixels each.
    EXPECT_NEAR(total(far_field(field, 3.0, 3 * samples)), power,
                1e-12 * power);  // This is rounding.
  }
}

// The spot of the sampled plane wave is Dirichlet's kernel. Its integral over every pixel comes
// out to rounding, for pixels of any size: there is no pixel integration error.
TEST(LensletOptics, PixelsAreIntegratedExactly) {
  constexpr int kSamples = 16;
  const auto dirichlet = [](double u) {
    const double small = std::sin(kPi * u / kSamples);
    return std::abs(small) < 1e-12 ? 1.0 : std::sin(kPi * u) / (kSamples * small);
  };
  for (const double per_lambda_w : {0.8, 2.0, 3.7}) {
    constexpr int kPatch = 9;
    const Image<double> patch = far_field(plane_wave(kSamples, 0.0, 0.0), per_lambda_w, kPatch);
    for (int i = 0; i < kPatch; ++i) {
      for (int j = 0; j < kPatch; ++j) {
        const auto side = [&](int k) {
          const double u = (k - 0.5 * (kPatch - 1)) / per_lambda_w;
          return integrate_pixel(dirichlet, u - 0.5 / per_lambda_w, u + 0.5 / per_lambda_w);
        };
        EXPECT_NEAR(patch(i, j), side(i) * side(j), 1e-12);  // This is rounding.
      }
    }
  }
}

// The spot of a continuous lenslet is sinc². Point samples differ by (πu/n)²/3 of the intensity, u
// being at most 4 λ/w here, so that doubling n divides the error by 4.
TEST(LensletOptics, SpotTendsToSincSquared) {
  const auto sinc = [](double u) {
    return std::abs(u) < 1e-9 ? 1.0 : std::sin(kPi * u) / (kPi * u);
  };
  double error[2] = {0.0, 0.0};
  for (int pass = 0; pass < 2; ++pass) {
    const int samples = pass == 0 ? 32 : 64;
    const Image<double> patch = far_field(plane_wave(samples, 0.0, 0.0), 2.0, 16);
    for (int i = 0; i < 16; ++i) {
      for (int j = 0; j < 16; ++j) {
        const auto side = [&](int k) {
          const double u = (k - 7.5) / 2.0;
          return integrate_pixel(sinc, u - 0.25, u + 0.25);
        };
        error[pass] = std::max(error[pass], std::abs(patch(i, j) - side(i) * side(j)));
      }
    }
  }
  EXPECT_LT(error[0], 2e-4);  // The peak is .15; (π·.5/32)²/3 twice is 1.6e-3 of it.
  EXPECT_NEAR(error[0] / error[1], 4.0, 0.1);  // The next order leaves this.
}

// One pixel is a slope of 2π over the pixels per λ/w: the pattern moves as a whole, to larger
// columns for a slope along x and to larger rows for one along y.
TEST(LensletOptics, SlopeMovesTheSpotExactly) {
  const Image<double> still = far_field(plane_wave(32, 0.0, 0.0), 2.5, 24);
  const Image<double> moved =
      far_field(plane_wave(32, 3 * 2.0 * kPi / 2.5, -2.0 * kPi / 2.5), 2.5, 24);
  for (int i = 1; i < 24; ++i) {
    for (int j = 0; j + 3 < 24; ++j) {
      EXPECT_NEAR(moved(i - 1, j + 3), still(i, j), 1e-13);  // This is rounding.
    }
  }
}

// The gain of a finite window ±W for small tilts is 1 − 2W·sinc²(W)/∫sinc². Fine pixels stand for
// the continuous window; the last row is for pixels of .5 λ/w.
TEST(LensletOptics, WindowGainForSmallTilts) {
  struct Row {
    double half_window;
    double pixels_per_lambda_w;
    double gain;
  };
  for (const Row row : {Row{0.5, 20.0, 0.475}, Row{1.0, 20.0, 0.999}, Row{1.5, 20.0, 0.855},
                        Row{2.0, 20.0, 1.000}, Row{4.0, 20.0, 1.000}, Row{1.5, 2.0, 0.852}}) {
    const auto patch_px =
        static_cast<int>(std::lround(2.0 * row.half_window * row.pixels_per_lambda_w));
    const double slope = 0.01;  // It is small and changes the gain by 1e-5.
    const Image<double> patch =
        far_field(plane_wave(128, slope, 0.0), row.pixels_per_lambda_w, patch_px);
    const double moved_px = slope * row.pixels_per_lambda_w / (2.0 * kPi);
    // The tolerance is for the table's last digit (5e-4) and for pixels of .05 λ/w (2e-4 at W =
    // 1.5).
    EXPECT_NEAR(centroid_x(patch) / moved_px, row.gain, 1e-3) << "W = " << row.half_window;
  }
}

TEST(LensletOptics, RefusesAPatchWiderThanItsFarField) {
  EXPECT_NO_THROW(LensletOptics(16, 2.0, 32));
  try {
    LensletOptics(16, 2.0, 33);
    FAIL();
  } catch (const UsageError& error) {
    EXPECT_NE(std::string(error.what()).find("raise the field samples"), std::string::npos);
  }
  EXPECT_THROW(LensletOptics(16, 0.0, 8), UsageError);
  EXPECT_THROW(LensletOptics(1, 2.0, 1), UsageError);
}

}  // namespace
}  // namespace curlew
