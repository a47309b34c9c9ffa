#include "core/size_check.h"

#include <gtest/gtest.h>

#include "core/image.h"

namespace curlew {
namespace {

TEST(SizeCheckDeathTest, NamesTheStageAndBothSizes) {
  const Image<float> map(3, 4);
  check_size("split_slopes", "slopes", size_of(map), {3, 4});
  EXPECT_DEATH(check_size("split_slopes", "slopes", size_of(map), {3, 5}),
               "split_slopes was given slopes of 3 x 4 where 3 x 5 is needed");
}

}  // namespace
}  // namespace curlew
