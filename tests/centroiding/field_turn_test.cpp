// A turned spot pattern is no vortex: what subtract_turn() takes out of slopes and what it leaves.
#include "centroiding/field_turn.h"

#include <gtest/gtest.h>

#include <cmath>
#include <iostream>
#include <random>

namespace curlew {
namespace {

constexpr int kSide = 16;

struct Field {
  Field() : centroids(kSide, kSide), slopes(kSide, kSide) {
    for (std::size_t k = 0; k < slopes.x.size(); ++k) {
      centroids.state[k] = LensletState::kValid;
      centroids.flux_adu[k] = 1000.0F;
      slopes.valid[k] = 1;
    }
  }
  /// Adds the slopes of a turn, a vortex of charge 1 in the middle of a cell, and noise.
  void add(double turn, double vortex, double noise_rad, unsigned seed = 1) {
    std::mt19937 random(seed);
    std::normal_distribution<double> noise(0.0, 1.0);
    for (int r = 0; r < kSide; ++r) {
      for (int c = 0; c < kSide; ++c) {
        const double x = c - 7.5, y = r - 7.5;
        const double swirl = vortex / (x * x + y * y) + turn;
        slopes.x(r, c) += static_cast<float>(-swirl * y + noise_rad * noise(random));
        slopes.y(r, c) += static_cast<float>(swirl * x + noise_rad * noise(random));
      }
    }
  }
  float subtract() {
    CellSample sample;
    sample_cells(centroids, slopes, sample);
    return subtract_turn(centroids, sample, slopes);
  }
  Centroids centroids;
  SlopeField slopes;
};

TEST(FieldTurn, IsTakenOutExactly) {
  for (const double turn : {0.5, -0.02}) {
    Field field;
    field.add(turn, 0.0, 0.0);
    EXPECT_NEAR(field.subtract(), turn, 1e-5);
    for (std::size_t k = 0; k < field.slopes.x.size(); ++k) {
      EXPECT_NEAR(field.slopes.x[k], 0.0, 1e-4);
      EXPECT_NEAR(field.slopes.y[k], 0.0, 1e-4);
    }
  }
}

TEST(FieldTurn, AVortexStaysWholeWhereThePatternIsTurned) {
  constexpr unsigned kSeed = 7;
  std::cout << "seed " << kSeed << "\n";
  Field turned, straight;
  turned.add(0.4, 1.0, 0.05, kSeed);
  straight.add(0.0, 1.0, 0.05, kSeed);
  turned.subtract();
  for (std::size_t k = 0; k < turned.slopes.x.size(); ++k) {
    EXPECT_NEAR(turned.slopes.x[k], straight.slopes.x[k], 0.08);
    EXPECT_NEAR(turned.slopes.y[k], straight.slopes.y[k], 0.08);
  }
}

TEST(FieldTurn, NoiseIsLeftAlone) {
  int changed = 0;
  for (unsigned seed = 0; seed < 200; ++seed) {
    Field field;
    field.add(0.0, 0.0, 0.1, seed);
    if (field.subtract() != 0.0F) ++changed;
  }
  EXPECT_LE(changed, 1);
}

TEST(FieldTurn, DarkAndMissingLensletsKeepTheirSlopes) {
  Field field;
  field.add(0.5, 0.0, 0.0);
  field.centroids.state[0] = LensletState::kFaint;
  field.centroids.flux_adu[0] = 0.0F;
  field.centroids.state[1] = LensletState::kLost;
  field.slopes.valid[1] = 0;
  for (const std::size_t k : {std::size_t{0}, std::size_t{1}})
    field.slopes.x[k] = field.slopes.y[k] = 0.0F;
  field.subtract();
  for (const std::size_t k : {std::size_t{0}, std::size_t{1}}) {
    EXPECT_EQ(field.slopes.x[k], 0.0F);
    EXPECT_EQ(field.slopes.y[k], 0.0F);
  }
}

TEST(FieldTurn, AFewCellsTellNoTurn) {
  Field field;
  field.add(0.5, 0.0, 0.0);
  for (int r = 0; r < kSide; ++r)
    for (int c = 0; c < kSide; ++c)
      if (r >= 7) field.centroids.state(r, c) = LensletState::kFaint;
  for (int r = 0; r < 7; ++r)
    for (int c = 7; c < kSide; ++c) field.centroids.state(r, c) = LensletState::kFaint;
  EXPECT_EQ(field.subtract(), 0.0F);
}

}  // namespace
}  // namespace curlew
