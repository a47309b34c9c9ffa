#include "core/memory_limit.h"

#include <gtest/gtest.h>

#include <cstdlib>

#include "core/frame_exchange.h"
#include "tests/support/failure_text.h"

namespace curlew {
namespace {

TEST(MemoryLimit, IsThatOfTheEnvironmentWhereItIsANumber) {
  unsetenv("CURLEW_MEMORY_MB");
  EXPECT_EQ(memory_limit_bytes(), 1'024'000'000);
  setenv("CURLEW_MEMORY_MB", "50", 1);
  EXPECT_EQ(memory_limit_bytes(), 50'000'000);
  for (const char* nonsense : {"", "-1", "0", "1e3", "many", "99999999999999999999"}) {
    setenv("CURLEW_MEMORY_MB", nonsense, 1);
    EXPECT_EQ(memory_limit_bytes(), 1'024'000'000) << nonsense;
  }
  unsetenv("CURLEW_MEMORY_MB");
}

TEST(MemoryLimit, TheSentenceHasBothFigures) {
  EXPECT_EQ(failure_text([] { require_memory("a thing", 1e9); }), "");
  EXPECT_EQ(failure_text([] { require_memory("a thing", 6e9); }),
            "a thing takes 6000 MB of memory, and 1024 MB is the limit; CURLEW_MEMORY_MB in the "
            "environment sets another");
}

TEST(MemoryLimit, FrameBuffersAreNotMadeBeyondIt) {
  FrameFormat format;
  format.rows = format.cols = 65535;
  const std::string text = failure_text([&] { FrameExchange exchange(format, 1000); });
  EXPECT_NE(text.find("8589672 MB of memory"), std::string::npos) << text;
}

}  // namespace
}  // namespace curlew
