#include "service/results/truth_match.h"

#include <gtest/gtest.h>

namespace curlew {
namespace {

Vortex found_at(float x, float y, int charge) {
  Vortex vortex;
  vortex.x = x;
  vortex.y = y;
  vortex.charge = charge;
  return vortex;
}

TEST(MatchTruth, NearestOfTheSameSignOneToOne) {
  const std::vector<TruthVortex> truth{{0, 5, 5, 1, 9}, {0, 5.5, 5, 1, 9}, {0, 9, 9, -1, 9}};
  const std::vector<Vortex> found{found_at(5.4F, 5, 1), found_at(5.3F, 5, 1), found_at(9.1F, 9, 1),
                                  found_at(9, 9.8F, -1)};
  const TruthMatch match = match_truth(found, truth);
  EXPECT_EQ(match.hits, 2);
  EXPECT_EQ(match.truth_of_found[0], 1);
  EXPECT_EQ(match.truth_of_found[1], 0);
  EXPECT_EQ(match.truth_of_found[2], -1) << "it has the wrong sign";
  EXPECT_EQ(match.truth_of_found[3], -1) << "it lies 0.8 pitches off";
}

}  // namespace
}  // namespace curlew
