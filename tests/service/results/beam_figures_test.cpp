// Where a beam is and how large, on beams whose moments are known by a formula.
#include "service/results/beam_figures.h"

#include <gtest/gtest.h>

#include <cmath>

#include "service/results/beam_json.h"

namespace curlew {
namespace {

constexpr int kRows = 30;
constexpr int kCols = 40;

/// Returns the light of a Gaussian beam with these 1/e² radii in each lenslet, which is the
/// integral over its square.
Image<float> gaussian(double x, double y, double wx, double wy, double light = 1e6) {
  Image<float> map(kRows, kCols);
  const auto part = [](double from_centre, double w) {
    const auto below = [&](double u) { return 0.5 * std::erf(std::sqrt(2.0) * u / w); };
    return below(from_centre + 0.5) - below(from_centre - 0.5);
  };
  for (int row = 0; row < kRows; ++row)
    for (int col = 0; col < kCols; ++col)
      map(row, col) = static_cast<float>(light * part(col - x, wx) * part(row - y, wy));
  return map;
}

const Image<std::uint8_t> kAll(kRows, kCols, 1);

TEST(BeamFigures, OfAGaussianAreItsOwn) {
  const BeamFigures beam = measure_beam(gaussian(18.3, 14.1, 6.0, 4.0), kAll);
  EXPECT_NEAR(beam.light, 1e6, 10.0);
  EXPECT_NEAR(beam.x, 18.3, 1e-3);
  EXPECT_NEAR(beam.y, 14.1, 1e-3);
  // D4σ is the 1/e² diameter. Squares of one pitch widen it: their variance is 1/12 (Sheppard).
  EXPECT_NEAR(beam.d4sigma_x, 4.0 * std::sqrt(9.0 + 1.0 / 12.0), 2e-3);
  EXPECT_NEAR(beam.d4sigma_y, 4.0 * std::sqrt(4.0 + 1.0 / 12.0), 2e-3);
  EXPECT_LT(beam.rim, 1e-6);
  for (const double edge : beam.edge) EXPECT_LT(edge, 1e-6);
}

TEST(BeamFigures, MoveWithTheBeamAndTurnWithTheMap) {
  const BeamFigures here = measure_beam(gaussian(15.0, 15.0, 5.0, 3.0), kAll);
  const BeamFigures there = measure_beam(gaussian(20.0, 13.0, 5.0, 3.0), kAll);
  EXPECT_NEAR(there.x - here.x, 5.0, 1e-3);
  EXPECT_NEAR(there.y - here.y, -2.0, 1e-3);
  EXPECT_NEAR(there.d4sigma_x, here.d4sigma_x, 1e-3);
  const Image<float> map = gaussian(15.0, 12.0, 5.0, 3.0);
  Image<float> turned(kCols, kRows);
  for (int row = 0; row < kRows; ++row)
    for (int col = 0; col < kCols; ++col) turned(col, row) = map(row, col);
  const BeamFigures a = measure_beam(map, kAll);
  const BeamFigures b = measure_beam(turned, Image<std::uint8_t>(kCols, kRows, 1));
  EXPECT_NEAR(a.x, b.y, 1e-9);
  EXPECT_NEAR(a.d4sigma_x, b.d4sigma_y, 1e-9);
  EXPECT_NEAR(a.rim, b.rim, 1e-9);
}

TEST(BeamFigures, OfHalfABeam) {
  // Its centre is on the left edge of lenslet 0. Half a Gaussian has its centroid at σ·√(2/π) and
  // the variance σ²·(1 − 2/π).
  const double sigma = 4.0;
  const BeamFigures beam = measure_beam(gaussian(-0.5, 15.0, 2.0 * sigma, 5.0), kAll);
  EXPECT_NEAR(beam.light, 5e5, 50.0);
  EXPECT_NEAR(beam.x + 0.5, sigma * std::sqrt(2.0 / M_PI), 0.03);
  EXPECT_NEAR(beam.d4sigma_x, 4.0 * sigma * std::sqrt(1.0 - 2.0 / M_PI), 0.1);
  EXPECT_EQ(beam.edge[static_cast<std::size_t>(BeamEdge::kLeft)], 1.0);
  EXPECT_NEAR(beam.rim, std::erf(1.0 / (std::sqrt(2.0) * sigma)), 1e-3);
}

TEST(BeamFigures, AnEvenlyLitArrayHasTheRimThatItHas) {
  const BeamFigures beam = measure_beam(Image<float>(kRows, kCols, 5.0F), kAll);
  EXPECT_NEAR(beam.x, (kCols - 1) / 2.0, 1e-9);
  EXPECT_NEAR(beam.d4sigma_x, 4.0 * std::sqrt((kCols * kCols - 1.0) / 12.0), 1e-6);
  EXPECT_NEAR(beam.rim, (2.0 * kRows + 2.0 * kCols - 4.0) / (kRows * kCols), 1e-9);
}

TEST(BeamFigures, UnlitLensletsAndFaintOnesDoNotCountAndNoHoleIsARim) {
  Image<float> flux = gaussian(18.0, 14.0, 5.0, 5.0);
  Image<LensletState> state(kRows, kCols, LensletState::kValid);
  for (int row = 0; row < kRows; ++row) {
    state(row, 0) = LensletState::kUnlit;
    flux(row, 0) = 1e6F;
    state(row, kCols - 1) = LensletState::kFaint;
    flux(row, kCols - 1) = 1e6F;
  }
  state(14, 25) = LensletState::kUnlit;
  const BeamFigures beam = measure_beam(flux, state);
  EXPECT_NEAR(beam.x, 18.0, 0.05);
  EXPECT_LT(beam.rim, 1e-3);
  state(14, 18) = LensletState::kSaturated;
  EXPECT_NEAR(measure_beam(flux, state).x, beam.x, 1e-9) << "saturated light is light";
}

TEST(BeamFigures, WithoutLightThereAreNoneAndThatIsSaid) {
  const BeamFigures dark = measure_beam(Image<float>(kRows, kCols), kAll);
  EXPECT_FALSE(dark.is_lit());
  EXPECT_TRUE(std::isnan(dark.x) && std::isnan(dark.d4sigma_y) && std::isnan(dark.rim));
  EXPECT_EQ(beam_json(dark, 1e-4).dump(), R"({"without":"no lenslet has light"})");
  EXPECT_FALSE(measure_beam(gaussian(5, 5, 3, 3), Image<std::uint8_t>(kRows, kCols)).is_lit());
  const auto json = beam_json(measure_beam(gaussian(18, 14, 6, 4), kAll), 300e-6);
  EXPECT_NEAR(json["d4sigma_x_mm"], 0.3 * json["d4sigma_x"].get<double>(), 1e-12);
  EXPECT_TRUE(beam_json(measure_beam(gaussian(18, 14, 6, 4), kAll), NAN)["d4sigma_x_mm"].is_null());
}

TEST(BeamFigures, ABeamIsCutWhereItsContourCrossesTheEdge) {
  const double w = 5.0;
  const BeamFigures reference = measure_beam(gaussian(19.5, 14.5, w, w), kAll);
  const auto edges_at = [&](double x, double y) {
    return edges_that_cut(measure_beam(gaussian(x, y, w, w), kAll), reference);
  };
  EXPECT_EQ(edges_at(19.5, 14.5), "");
  EXPECT_EQ(edges_at(w + 0.6, 14.5), "") << "the contour is just within";
  EXPECT_EQ(edges_at(w - 0.6, 14.5), "left");
  EXPECT_EQ(edges_at(kCols - 1 - w + 0.6, 14.5), "right");
  EXPECT_EQ(edges_at(19.5, 2.0), "top") << "row 0 is at the top";
  EXPECT_EQ(edges_at(38.0, 28.0), "right and bottom");
}

TEST(BeamFigures, ARoundArrayHasEdgesInTheDirectionsFromItsMiddle) {
  Image<std::uint8_t> disc(20, 20);
  for (int row = 0; row < 20; ++row)
    for (int col = 0; col < 20; ++col)
      disc(row, col) = std::hypot(col - 9.5, row - 9.5) < 8.5 ? 1 : 0;
  const auto beam_at = [&](double x, double y) {
    Image<float> map(20, 20);
    for (int row = 0; row < 20; ++row)
      for (int col = 0; col < 20; ++col)
        map(row, col) =
            static_cast<float>(std::exp(-2.0 * (std::pow(col - x, 2) + std::pow(row - y, 2)) / 25));
    return measure_beam(map, disc);
  };
  const BeamFigures reference = beam_at(9.5, 9.5);
  EXPECT_EQ(edges_that_cut(beam_at(9.5, 9.5), reference), "");
  EXPECT_EQ(edges_that_cut(beam_at(4.0, 9.5), reference), "left");
  EXPECT_EQ(edges_that_cut(beam_at(9.5, 15.0), reference), "bottom");
  EXPECT_EQ(edges_that_cut(beam_at(14.0, 5.0), reference), "right and top");
}

TEST(BeamFigures, ABeamThatFillsTheArrayLeavesItWhenItMovesOff) {
  const auto filled_from = [](int dark_cols) {
    Image<float> map(kRows, kCols, 1.0F);
    for (int row = 0; row < kRows; ++row)
      for (int col = 0; col < dark_cols; ++col) map(row, col) = 0.0F;
    return measure_beam(map, kAll);
  };
  EXPECT_EQ(edges_that_cut(filled_from(0), filled_from(0)), "");
  EXPECT_EQ(edges_that_cut(filled_from(4), filled_from(0)), "");
  EXPECT_EQ(edges_that_cut(filled_from(14), filled_from(0)), "right");
  EXPECT_EQ(edges_that_cut(filled_from(0), BeamFigures{}), "") << "nothing to hold it against";
}

}  // namespace
}  // namespace curlew
