#include "service/air/air_meter.h"

#include <gtest/gtest.h>

namespace curlew {
namespace {

TEST(AirMeter, TellsR0OnlyWhereSlopesAreThoseOfTheAir) {
  EXPECT_EQ(doubt_of_r0({0.08, 0.01}, 0.0), "");
  EXPECT_EQ(doubt_of_r0({0.18, 0.01}, 15.0), "");
  EXPECT_EQ(doubt_of_r0({}, 0.0), "") << "without a scintillation index nothing speaks against it";
  EXPECT_NE(doubt_of_r0({0.18, 0.01}, 0.0).find("--fresnel"), std::string::npos);
  EXPECT_NE(doubt_of_r0({0.7, 0.01}, 15.0).find("0.7"), std::string::npos);
}

TEST(AirMeter, TellsR0OfModesOnlyWhereDiffractionIsSmallBesideTheArray) {
  EXPECT_EQ(doubt_of_modes(0.0, 16), "");
  EXPECT_EQ(doubt_of_modes(4.0, 16), "");
  EXPECT_NE(doubt_of_modes(15.6, 16).find("15.6 pitches"), std::string::npos);
}

}  // namespace
}  // namespace curlew
