// What makes a run's phase and vortices less sure than they look is said.
#include <gtest/gtest.h>

#include "service/pipeline.h"

namespace curlew {
namespace {

RunReport report_of(std::int64_t measured, std::int64_t lost, std::int64_t in_islands) {
  RunReport report;
  report.frames = 10;
  report.lenslets = 1000;
  report.measured = measured;
  report.lost = lost;
  report.in_islands = in_islands;
  return report;
}

TEST(Doubts, AreSaidOfFadedLensletsAndOfIslands) {
  EXPECT_TRUE(doubts(report_of(1000, 0, 0)).empty());
  EXPECT_TRUE(doubts(report_of(960, 0, 0)).empty());
  ASSERT_EQ(doubts(report_of(900, 0, 0)).size(), 1U);
  EXPECT_EQ(doubts(report_of(900, 0, 0))[0].rfind("10 % of the lenslets in the beam", 0), 0U);
  EXPECT_TRUE(doubts(report_of(600, 400, 0)).empty()) << "a smaller beam is no doubt";
  ASSERT_EQ(doubts(report_of(1000, 0, 3)).size(), 1U);
  EXPECT_EQ(doubts(report_of(1000, 0, 3))[0].rfind("in 3 of 10 frames", 0), 0U);
  EXPECT_TRUE(doubts(report_of(0, 0, 3)).empty()) << "nothing was measured, which is another word";
}

TEST(Doubts, AreSaidOfSpotsThatTheClassifierDoesNotKnow) {
  RunReport report = report_of(1000, 0, 0);
  report.too_blurred = 4;
  ASSERT_EQ(doubts(report).size(), 1U);
  EXPECT_EQ(doubts(report)[0].rfind("in 4 of 10 frames the spots were wider", 0), 0U);
}

TEST(Doubts, AddUpOverRuns) {
  RunReport sum = report_of(500, 10, 1);
  sum.too_blurred = 1;
  RunReport more = report_of(400, 20, 2);
  more.too_blurred = 3;
  sum.merge(more);
  EXPECT_EQ(sum.too_blurred, 4);
  EXPECT_EQ(sum.lenslets, 2000);
  EXPECT_EQ(sum.in_islands, 3);
}

}  // namespace
}  // namespace curlew
