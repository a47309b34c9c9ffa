#include "centroiding/calibration/grid_fit.h"

#include <gtest/gtest.h>

#include <cmath>

namespace curlew {
namespace {

LensletGrid turned_grid() {
  LensletGrid grid;
  grid.origin_x_px = 40.0;
  grid.origin_y_px = 30.0;
  grid.p11 = 12.0;
  grid.p21 = 5.0;
  grid.p12 = -5.0;
  grid.p22 = 12.0;
  return grid;
}

/// Returns 5×5 spots in their places.
IndexedSpots spots_on(const LensletGrid& grid) {
  IndexedSpots spots;
  for (int row = -2; row <= 2; ++row) {
    for (int col = -2; col <= 2; ++col) {
      const auto [x, y] = grid.pixel_from_lenslet(col, row);
      spots[{col, row}] = {x, y, 100.0, 1.0, false};
    }
  }
  return spots;
}

TEST(GridFit, CutAndSmearedSpotsDoNotTiltIt) {
  const LensletGrid truth = turned_grid();
  IndexedSpots spots = spots_on(truth);
  spots[{2, 2}].x += 4.0;
  spots[{-2, 1}].y -= 3.0;
  spots[{-2, 1}].cut = true;
  LensletGrid fitted;
  ASSERT_TRUE(fit_grid(fitted, spots));
  // The other spots are exact, so that only the rounding of numbers up to 64 is left.
  constexpr double kRounding = 1e-11;
  EXPECT_NEAR(fitted.origin_x_px, truth.origin_x_px, kRounding);
  EXPECT_NEAR(fitted.origin_y_px, truth.origin_y_px, kRounding);
  EXPECT_NEAR(fitted.p11, truth.p11, kRounding);
  EXPECT_NEAR(fitted.p12, truth.p12, kRounding);
  EXPECT_NEAR(fitted.p21, truth.p21, kRounding);
  EXPECT_NEAR(fitted.p22, truth.p22, kRounding);
  EXPECT_NEAR(anisotropy_of(fitted), 0.0, kRounding);
}

/// Returns how far the fit to 25 spots moves in y when the one in the middle is off by `off_px`
/// there. It takes part with a 25th if it is kept, and not at all if it is left out.
double move_of_fit(const IndexedSpots& spots, double off_px) {
  IndexedSpots moved = spots;
  moved[{0, 0}].y += off_px;
  LensletGrid fitted;
  EXPECT_TRUE(fit_grid(fitted, moved));
  return fitted.origin_y_px - turned_grid().origin_y_px;
}

TEST(GridFit, AmongExactSpotsThoseOffByATwentiethOfThePitchAreLeftOut) {
  const IndexedSpots spots = spots_on(turned_grid());
  const double pitch_px = turned_grid().pitch_px();  // 13
  EXPECT_NEAR(move_of_fit(spots, 0.045 * pitch_px), 0.045 * pitch_px / 25.0, 1e-11);
  EXPECT_NEAR(move_of_fit(spots, 0.06 * pitch_px), 0.0, 1e-11);
}

TEST(GridFit, AmongScatteredSpotsThoseOffByThriceTheMedianAreLeftOut) {
  IndexedSpots spots = spots_on(turned_grid());
  // Twelve spots are 1 px to the right and twelve to the left, so that the fit does not move.
  for (auto& [at, spot] : spots) {
    if (at != LensletIndex{0, 0}) spot.x += (at.first + at.second) % 2 == 0 ? 1.0 : -1.0;
  }
  EXPECT_NEAR(move_of_fit(spots, 2.8), 2.8 / 25.0, 1e-11);
  EXPECT_NEAR(move_of_fit(spots, 3.3), 0.0, 1e-11);
}

TEST(GridFit, RefusesSpotsOnOneLineAndSpotsThatAreAllCut) {
  const IndexedSpots all = spots_on(turned_grid());
  IndexedSpots line;
  for (int col = -2; col <= 2; ++col) line[{col, 1}] = all.at({col, 1});
  IndexedSpots cut = all;
  for (auto& [at, spot] : cut) spot.cut = true;
  LensletGrid grid;
  EXPECT_FALSE(fit_grid(grid, line));
  EXPECT_FALSE(fit_grid(grid, cut));
  EXPECT_FALSE(fit_grid(grid, {}));
}

TEST(GridFit, RmsDistanceIsOfWholeSpotsAndOfAllWhereNoneIsWhole) {
  const LensletGrid grid = turned_grid();
  IndexedSpots spots = spots_on(grid);
  for (auto& [at, spot] : spots) spot.x += 0.5;
  spots[{0, 0}].x += 2.0;
  spots[{0, 0}].cut = true;
  // The distances are .5 px for 24 spots and 2.5 px for the one that is cut. The tolerance is for
  // the rounding of numbers up to 64.
  EXPECT_NEAR(rms_distance_px(grid, spots), 0.5, 1e-13);
  for (auto& [at, spot] : spots) spot.cut = true;
  EXPECT_NEAR(rms_distance_px(grid, spots), std::sqrt((24.0 * 0.25 + 6.25) / 25.0), 1e-13);
  EXPECT_EQ(rms_distance_px(grid, {}), 0.0);
}

}  // namespace
}  // namespace curlew
