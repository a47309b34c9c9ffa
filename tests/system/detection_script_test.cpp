// docs/detection.sh in its short form: one command can measure again the main tables of
// docs/lab/detection.md and the values of docs/paper.md.
#include <gtest/gtest.h>

#include <array>
#include <cstdio>
#include <fstream>
#include <sstream>
#include <string>

#include "tests/support/paths.h"
#include "tests/support/program.h"

namespace curlew {
namespace {

std::string text_of(const std::string& path) {
  std::ostringstream text;
  text << std::ifstream(path).rdbuf();
  return text.str();
}

TEST(DetectionScript, QuickFormMeasuresEverything) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__) || !defined(NDEBUG)
  GTEST_SKIP() << "benchmarks are for release builds";
#endif
  const ScratchDirectory scratch;
  const std::string command = std::string("XDG_CACHE_HOME='") + scratch.path() +
                              "/cache' CURLEW='" + kCurlewProgram + "' bash '" + kSourceDir +
                              "/docs/detection.sh' --quick '" + scratch.path() + "/out' 2>&1";
  FILE* pipe = popen(command.c_str(), "r");
  ASSERT_NE(pipe, nullptr);
  std::string said;
  for (int c = 0; (c = fgetc(pipe)) != EOF;) said += static_cast<char>(c);
  ASSERT_EQ(WEXITSTATUS(pclose(pipe)), 0) << said;
  struct Expected {
    const char* file;
    const char* word;
  };
  constexpr std::array kExpected{Expected{"detect", "Rytov variance 4, 200 photons"},
                                 Expected{"detect_round", "classifier"},
                                 Expected{"detect_obscured", "whitened"},
                                 Expected{"detect_weighted", "d_centroid"},
                                 Expected{"detect_lenslet", "classifier"},
                                 Expected{"detect_window", "classifier"},
                                 Expected{"detect_sampling", "classifier"},
                                 Expected{"detect_field", "turned by 20 degrees"},
                                 Expected{"false_alarms", "whitened"},
                                 Expected{"classifier", "80 x 80"},
                                 Expected{"bound", "bound, 6x6 lenslets"},
                                 Expected{"track", "switches a frame"},
                                 Expected{"phase", "hidden_true"},
                                 Expected{"paper", "Fig. 8 peak"}};
  for (const Expected& expected : kExpected) {
    const std::string text = text_of(scratch / ("out/" + std::string(expected.file) + ".txt"));
    EXPECT_NE(text.find(expected.word), std::string::npos) << expected.file << ":\n" << text;
  }
}

}  // namespace
}  // namespace curlew
