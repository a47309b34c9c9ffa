#include "centroiding/calibration/lenslet_grid_finder.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <string>

#include "core/error.h"
#include "tests/centroiding/drawn_spots.h"
#include "tests/support/text.h"

namespace curlew {
namespace {

/// Returns the sentence with which find_lenslet_grid() fails, and nothing if it does not fail.
std::string refusal(const Image<float>& image) {
  try {
    find_lenslet_grid(image, {}, false);
  } catch (const Failure& failure) {
    return failure.what();
  }
  return {};
}

/// Returns the largest distance, in px, of a lit place of the found grid from the nearest place of
/// the true one.
double worst_error_px(const FoundGrid& found, const LensletGrid& truth) {
  double worst = 0.0;
  for (int r = 0; r < found.grid.rows; ++r) {
    for (int c = 0; c < found.grid.cols; ++c) {
      if (found.lit(r, c) == 0) continue;
      const auto [x, y] = found.grid.pixel_from_lenslet(c, r);
      const auto [col, row] = truth.lenslet_from_pixel(x, y);
      const auto [tx, ty] = truth.pixel_from_lenslet(std::round(col), std::round(row));
      worst = std::max(worst, std::hypot(x - tx, y - ty));
    }
  }
  return worst;
}

bool row_has_light(const FoundGrid& found, int row) {
  for (int c = 0; c < found.grid.cols; ++c) {
    if (found.lit(row, c) != 0) return true;
  }
  return false;
}

bool col_has_light(const FoundGrid& found, int col) {
  for (int r = 0; r < found.grid.rows; ++r) {
    if (found.lit(r, col) != 0) return true;
  }
  return false;
}

/// Finds the grid of what is drawn and compares it with the truth.
void expect_found(const DrawnSpots& drawn) {
  SCOPED_TRACE("pitch " + std::to_string(drawn.pitch_px) + " rotation " +
               std::to_string(drawn.rotation_deg) + " mirrored " + std::to_string(drawn.mirrored) +
               " seed " + std::to_string(drawn.seed));
  int count = 0;
  const Image<float> image = drawn.draw(&count);
  const FoundGrid found = find_lenslet_grid(image, {}, drawn.mirrored);
  EXPECT_EQ(found.n_lit, count);
  // At 5 px the wings of neighbours reach under each spot. They shift its centre of mass by up to
  // .06 px, depending on its place on the pixels. The jitter of n spots leaves an error of
  // 3·jitter/√n, and twice that at the edge.
  const double jitter_error = 6.0 * drawn.jitter_px / std::sqrt(count);
  EXPECT_LT(worst_error_px(found, drawn.grid()), 0.08 + jitter_error);
  const double across_px = std::sqrt(count) * drawn.pitch_px;
  const double degrees = (0.08 + jitter_error) / across_px * 2.0 * 57.3;
  EXPECT_NEAR(found.grid.rotation_deg(), drawn.rotation_deg, degrees);
  EXPECT_NEAR(found.grid.pitch_px(), drawn.pitch_px,
              (0.08 + jitter_error) * 2.0 / std::sqrt(count));
  EXPECT_EQ(found.grid.determinant() < 0.0, drawn.mirrored);
  EXPECT_GT(found.grid.p11, 0.0);
  EXPECT_TRUE(row_has_light(found, 0) && row_has_light(found, found.grid.rows - 1));
  EXPECT_TRUE(col_has_light(found, 0) && col_has_light(found, found.grid.cols - 1));
}

TEST(LensletGridFinder, FindsAnyPitchAndRotationInRoundAndObscuredPupils) {
  unsigned seed = 100;
  for (const double pitch : {5.0, 6.0, 9.7, 16.0, 30.0}) {
    for (const double rotation : {-44.0, -21.0, 0.0, 0.5, 10.0, 44.0}) {
      DrawnSpots drawn;
      drawn.pitch_px = pitch;
      drawn.rotation_deg = rotation;
      drawn.mirrored = seed % 2 == 1;
      drawn.seed = ++seed;
      if (pitch < 8.0) {
        drawn.frame_rows = 100;
        drawn.frame_cols = 120;
        drawn.centre_x_px = 60.3;
        drawn.centre_y_px = 50.1;
      }
      const double radius = 0.45 * drawn.frame_rows;
      const double hole = seed % 3 == 0 ? 0.3 * radius : -1.0;
      drawn.lit = [radius, hole](double x, double y) {
        return std::hypot(x, y) < radius && std::hypot(x, y) > hole;
      };
      expect_found(drawn);
    }
  }
}

TEST(LensletGridFinder, FindsGridsThatFillTheFrame) {
  unsigned seed = 200;
  for (const double pitch : {6.0, 8.3, 16.0, 30.0}) {
    for (const double rotation : {-33.0, 0.0, 0.7, 20.0}) {
      DrawnSpots drawn;
      drawn.pitch_px = pitch;
      drawn.rotation_deg = rotation;
      drawn.seed = ++seed;
      if (pitch < 9.0) {
        drawn.frame_rows = 120;
        drawn.frame_cols = 96;
        drawn.centre_x_px = 47.3;
        drawn.centre_y_px = 60.6;
      }
      expect_found(drawn);
    }
  }
}

TEST(LensletGridFinder, FindsWindowsWithoutGapsOnAnAlignedDetector) {
  DrawnSpots drawn = drawn_without_gaps();
  drawn.brightness_spread = 0.3;
  drawn.jitter_px = 0.3;
  drawn.seed = 5;
  const FoundGrid found = find_lenslet_grid(drawn.draw(), {}, false);
  EXPECT_EQ(found.grid.rows, 40);
  EXPECT_EQ(found.grid.cols, 40);
  EXPECT_EQ(found.n_lit, 1600);
  // .3 px of jitter on 1600 spots gives .3/√1600 = .0075, and the limit is four times this. Pixels
  // shift the spots by as much again.
  EXPECT_NEAR(found.grid.origin_x_px, 2.5, 0.06);
  EXPECT_NEAR(found.grid.origin_y_px, 2.5, 0.06);
  EXPECT_NEAR(found.grid.pitch_px(), 6.0, 0.002);
}

TEST(LensletGridFinder, FindsWidePitches) {
  for (const double pitch : {60.0, 100.0}) {
    DrawnSpots drawn;
    drawn.frame_rows = 512;
    drawn.frame_cols = 512;
    drawn.centre_x_px = 255.2;
    drawn.centre_y_px = 251.7;
    drawn.pitch_px = pitch;
    drawn.rotation_deg = -12.0;
    drawn.seed = 7;
    drawn.lit = [](double x, double y) { return std::hypot(x, y) < 235.0; };
    expect_found(drawn);
  }
}

TEST(LensletGridFinder, StandsAberrationUnevenLightAndNoise) {
  DrawnSpots drawn;
  drawn.pitch_px = 30.0;
  drawn.frame_rows = 512;
  drawn.frame_cols = 512;
  drawn.centre_x_px = 250.0;
  drawn.centre_y_px = 260.0;
  drawn.jitter_px = 1.4;  // This makes 2 px rms in two axes.
  drawn.brightness_spread = 0.3;
  drawn.noise_adu = 60.0;
  // Frames from which a mean was subtracted are negative.
  drawn.background_adu = -200.0;
  drawn.seed = 11;
  drawn.lit = [](double x, double y) { return std::hypot(x, y) < 215.0; };
  expect_found(drawn);
}

TEST(LensletGridFinder, LeavesMissingSpotsOutAndHotPixelsAlone) {
  DrawnSpots drawn;
  drawn.pitch_px = 16.0;
  drawn.rotation_deg = 3.0;
  drawn.seed = 13;
  drawn.lit = [](double x, double y) {
    const bool dark = std::hypot(x - 33.0, y) < 9.0 || std::hypot(x, y + 48.0) < 20.0;
    return std::hypot(x, y) < 100.0 && !dark;
  };
  int count = 0;
  Image<float> image = drawn.draw(&count);
  std::mt19937 random(drawn.seed);
  for (int i = 0; i < 300; ++i) image[random() % image.size()] = 60000.0F;
  image(40, 50) = std::numeric_limits<float>::quiet_NaN();
  const FoundGrid found = find_lenslet_grid(image, {}, false);
  EXPECT_EQ(found.n_lit, count);
  // One spot in 12 has a hot pixel somewhere near, and what replaces the pixel is right to some
  // hundred ADU.
  EXPECT_LT(worst_error_px(found, drawn.grid()), 0.1);
}

TEST(LensletGridFinder, TakesNoLightFromBadPixels) {
  DrawnSpots drawn;
  drawn.seed = 17;
  Image<float> image = drawn.draw();
  Image<std::uint8_t> bad(image.rows(), image.cols(), 0);
  for (int r = 0; r < image.rows(); ++r) {
    for (int c = 100; c < 103; ++c) {
      image(r, c) = 65535.0F;
      bad(r, c) = 1;
    }
  }
  const FoundGrid found = find_lenslet_grid(image, bad, false);
  EXPECT_LT(worst_error_px(found, drawn.grid()), 0.1);  // This is the limit of the test above.
}

TEST(LensletGridFinder, MeasuresNoiseAndBackgroundBetweenTheSpots) {
  DrawnSpots drawn;
  drawn.pitch_px = 30.0;
  drawn.background_adu = 350.0;
  drawn.noise_adu = 12.0;
  drawn.seed = 19;
  const FoundGrid found = find_lenslet_grid(drawn.draw(), {}, false);
  // Some 5,000 pixels lie midway. They give an error of 12·1.25/√5000 = .2 for the median and of
  // 1.2 % for the scatter. The limits are five σ.
  EXPECT_NEAR(found.background_adu, 350.0, 1.1);
  EXPECT_NEAR(found.noise_adu, 12.0, 0.7);
}

TEST(LensletGridFinder, RefusesHexagonalLayoutsByName) {
  unsigned seed = 300;
  for (const double pitch : {8.0, 14.0, 31.0}) {
    for (const double rotation : {-40.0, -15.0, 0.0, 17.0, 30.0}) {
      DrawnSpots drawn;
      drawn.pitch_px = pitch;
      drawn.rotation_deg = rotation;
      drawn.angle_between_deg = 60.0;
      drawn.seed = ++seed;
      SCOPED_TRACE("pitch " + std::to_string(pitch) + " rotation " + std::to_string(rotation) +
                   " seed " + std::to_string(seed));
      EXPECT_TRUE(contains(refusal(drawn.draw()), "hexagonal"));
    }
  }
}

TEST(LensletGridFinder, RefusesStretchedAndShearedGrids) {
  DrawnSpots stretched;
  stretched.stretch = 1.3;
  EXPECT_TRUE(contains(refusal(stretched.draw()), "square"));
  stretched.stretch = 1.08;
  EXPECT_TRUE(contains(refusal(stretched.draw()), "square"));
  DrawnSpots sheared;
  sheared.angle_between_deg = 85.0;
  EXPECT_TRUE(contains(refusal(sheared.draw()), "square"));
}

TEST(LensletGridFinder, SaysInOneSentenceWhyThereIsNoGrid) {
  EXPECT_TRUE(contains(refusal(Image<float>(64, 64, 0.0F)), "no light"));
  EXPECT_TRUE(contains(refusal(Image<float>(64, 64, 65535.0F)), "saturated"));
  EXPECT_TRUE(contains(refusal(Image<float>(64, 64, std::numeric_limits<float>::quiet_NaN())),
                       "usable pixels"));

  DrawnSpots noise_only;
  noise_only.lit = [](double, double) { return false; };
  for (noise_only.seed = 1; noise_only.seed <= 5; ++noise_only.seed) {
    SCOPED_TRACE(noise_only.seed);
    EXPECT_TRUE(contains(refusal(noise_only.draw()), "no grid of spots"));
  }

  DrawnSpots single;
  single.lit = [](double x, double y) { return std::hypot(x, y) < 5.0; };
  EXPECT_TRUE(contains(refusal(single.draw()), "no grid of spots"));

  DrawnSpots one_row;
  one_row.lit = [](double, double y) { return std::abs(y) < 5.0; };
  EXPECT_TRUE(contains(refusal(one_row.draw()), "no grid of spots"));

  Image<float> plateau = DrawnSpots{}.draw();
  for (int r = 20; r < 236; ++r) {
    for (int c = 20; c < 236; ++c) plateau(r, c) = 65535.0F;
  }
  EXPECT_TRUE(contains(refusal(plateau), "saturated"));
}

}  // namespace
}  // namespace curlew
