// A vortex is seen by light: its dark core among lit lenslets, and not in the dark beyond them.
#include "detect/classifier/lit_nodes.h"

#include <gtest/gtest.h>

namespace curlew {
namespace {

constexpr int kLenslets = 10;

Centroids lit_everywhere() {
  Centroids centroids(kLenslets, kLenslets);
  centroids.state.fill(LensletState::kValid);
  centroids.flux_adu.fill(100.0F);
  return centroids;
}

LitNodes look_at(const Centroids& centroids) {
  LitNodes nodes(centroids.state.rows(), centroids.state.cols());
  nodes.look_at(centroids, 100.0F);
  return nodes;
}

bool is_seen(const Centroids& centroids, int row, int col) {
  return look_at(centroids).is_seen(row, col);
}

bool is_seen_at(const Centroids& centroids, float x, float y) {
  Vortex vortex;
  vortex.x = x;
  vortex.y = y;
  return look_at(centroids).is_seen(vortex);
}

TEST(LitNodes, TheDarkCoreOfAVortexIsEvidence) {
  Centroids centroids = lit_everywhere();
  for (int row = 4; row <= 5; ++row)
    for (int col = 4; col <= 5; ++col) centroids.flux_adu(row, col) = 0.0F;
  EXPECT_TRUE(is_seen(centroids, 4, 4));
  EXPECT_TRUE(is_seen_at(centroids, 4.5F, 4.5F));
}

TEST(LitNodes, OneMissingLensletIsNoHindranceAndTwoAre) {
  Centroids centroids = lit_everywhere();
  centroids.state(4, 4) = LensletState::kUnlit;
  EXPECT_TRUE(is_seen(centroids, 4, 4));
  centroids.state(5, 5) = LensletState::kLost;
  EXPECT_FALSE(is_seen(centroids, 4, 4));
  EXPECT_FALSE(is_seen_at(centroids, 4.9F, 4.1F));
  EXPECT_TRUE(is_seen_at(centroids, 3.9F, 3.9F));
}

TEST(LitNodes, TheRimOfAShadowIsNoEvidence) {
  for (const bool missing : {true, false}) {
    Centroids centroids = lit_everywhere();
    for (int row = 3; row <= 6; ++row) {
      for (int col = 3; col <= 6; ++col) {
        centroids.flux_adu(row, col) = 1.0F;
        if (missing || row > 3) centroids.state(row, col) = LensletState::kLost;
      }
    }
    EXPECT_EQ(is_seen(centroids, 2, 2), !missing) << "at the corner of the shadow";
    EXPECT_FALSE(is_seen(centroids, 2, 4)) << "at its side";
    EXPECT_FALSE(is_seen(centroids, 4, 4)) << "within it";
    EXPECT_TRUE(is_seen(centroids, 1, 1)) << "beside it";
  }
}

TEST(LitNodes, TheArraysOwnEdgeIsNoShadow) {
  const Centroids centroids = lit_everywhere();
  EXPECT_TRUE(is_seen(centroids, 0, 0));
  EXPECT_TRUE(is_seen_at(centroids, 0.0F, 9.0F));
  EXPECT_TRUE(is_seen_at(centroids, 9.0F, 4.0F));
}

}  // namespace
}  // namespace curlew
