#include "service/air/air_meter.h"

#include <gtest/gtest.h>

namespace curlew {
namespace {

TEST(AirMeter, TellsR0OnlyWhereSlopesAreThoseOfTheAir) {
  EXPECT_EQ(doubt_of_r0({0.1, 0.01}, 0.0), "");
  EXPECT_EQ(doubt_of_r0({0.4, 0.01}, 15.0), "");
  EXPECT_EQ(doubt_of_r0({}, 0.0), "") << "without a scintillation index nothing speaks against it";
  EXPECT_NE(doubt_of_r0({0.4, 0.01}, 0.0).find("--fresnel"), std::string::npos);
  EXPECT_NE(doubt_of_r0({0.7, 0.01}, 15.0).find("0.7"), std::string::npos);
}

}  // namespace
}  // namespace curlew
