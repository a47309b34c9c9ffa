// docs/paper_figures.py in its short form must print the values of docs/paper.md and draw its
// pictures.
#include <gtest/gtest.h>

#include <cstdio>
#include <filesystem>
#include <map>
#include <numbers>
#include <sstream>
#include <string>

#include "tests/support/paths.h"
#include "tests/support/program.h"

namespace curlew {
namespace {

/// Returns the table's rows by their name, which ends at two spaces. The last column is curlew's
/// value.
std::map<std::string, double> rows_of(const std::string& text) {
  std::map<std::string, double> rows;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    const std::size_t name = line.find("  ");
    const std::size_t last = line.find_last_of(' ');
    if (name == std::string::npos || last == std::string::npos) continue;
    try {
      rows[line.substr(0, name)] = std::stod(line.substr(last));
    } catch (const std::invalid_argument&) {
      continue;  // this is the heading
    }
  }
  return rows;
}

TEST(PaperFigures, QuickFormPrintsTheValues) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "minutes of propagation, which tests of the simulator try under sanitizers";
#endif
  const ScratchDirectory scratch;
  const std::string command = std::string("/usr/bin/python3 '") + kSourceDir +
                              "/docs/paper_figures.py' '" + kCurlewProgram + "' '" +
                              scratch.path() + "' --quick 2>&1";
  FILE* pipe = popen(command.c_str(), "r");
  ASSERT_NE(pipe, nullptr);
  std::string said;
  for (int c = 0; (c = fgetc(pipe)) != EOF;) said += static_cast<char>(c);
  const int status = pclose(pipe);
  if (WEXITSTATUS(status) == 77 || WEXITSTATUS(status) == 127) GTEST_SKIP() << said;
  ASSERT_EQ(status, 0) << said;

  struct Expected {
    const char* name;
    double value;
    double tolerance;  // half a unit of the last digit printed; for spots see below
  };
  // The windows are ±4 λ/w, with 32 field samples a lenslet. VortexTruth has the same .05 for
  // spots.
  constexpr double kPi = std::numbers::pi;
  constexpr double kSix = 0.51e-6;
  constexpr double kFour = 0.51e-4;
  constexpr double kSpots = 0.06;
  const auto rows = rows_of(said);
  for (const Expected& row : {
           Expected{"Eq. 8 sum of D over 41 x 41 cells, round core", 2 * kPi, 1e-3},  // 1/r⁴ beyond
           {"Eq. 13 w times the mean gradient, D/4", 1.131971753677421, kSix},
           {"Eq. 14 round core on the node", 4.527887014709684, kSix},
           {"Eq. 16 round core at (1, 1)", -0.3966410308617583, kSix},
           {"Fig. 5 least D", -0.4107301049, kSix},
           {"Fig. 5 least D, |mu|", 0.971810, 0.51e-4},
           {"Fig. 5 least D, |nu|", 1.0, kFour},
           {"Fig. 5 at (1, 0)", 0.798362936, kSix},
           {"Fig. 5 at (2, 0)", 0.059602407, kSix},
           {"Fig. 5 at (2, 2)", -0.015835041, kSix},
           {"Fig. 5 mu = nu where D is 0", 0.82215773, 2e-4},  // interpolated in steps of .01
           {"Fig. 5 nearest node, least over positions", 1.4867, kFour},
           {"Fig. 5 nearest node, most over positions", 4.5279, kFour},
           {"Fig. 5 2x2 round the lenslet, least over positions", 5.728, 5e-4},
           {"Fig. 5 2x2 round the lenslet, most over positions", 5.978, 5e-4},
           {"Fig. 5 3x3 round the node, least over positions", 6.1249, kFour},
           {"Fig. 5 3x3 round the node, most over positions", 6.1371, kFour},
           {"Fig. 6 alpha 89.9, beta 0", kPi, 0.02},  // the limit is at 90°
           {"Fig. 6 alpha 89.9, beta 90", 2 * kPi, 0.03},
           {"Fig. 6 alpha 90.1, beta 0", -kPi, 0.02},
           {"Fig. 6 alpha 90.1, beta 90", -2 * kPi, 0.03},
           {"Fig. 6 alpha 180", -4.527887014709684, kSix},
           {"Fig. 6 alpha 15, spread over beta", 4.549194 - 4.506644, 2 * kSix},
           {"Fig. 6 alpha 89, spread over beta", 6.130695 - 3.233074, 2 * kSix},
           {"Fig. 7 peak", 4.319620, kSix},
           {"Fig. 7 slow axis from +mu towards +nu, degrees", 0.0, 1e-9},
           {"Fig. 7 at (0.5, 0)", 2.670063922, kSix},
           {"Fig. 7 at (0, 0.5)", 3.049048722, kSix},
           {"Fig. 7 at (1.5, 0)", 0.310083882, kSix},
           {"Fig. 7 at (0, 1.5)", 0.082030878, kSix},
           {"Fig. 8 peak", 5.524402, kSix},
           {"Fig. 8 slow axis from +mu towards +nu, degrees", 45.0, 1e-9},
           {"Fig. 8 at (0.5, 0.5)", 2.427911155, kSix},
           {"Fig. 8 at (0.5, -0.5)", 0.523797650, kSix},
           {"Fig. 8 least D", -0.519330961, kSix},
           {"Eq. A1 with ln|.|, greatest difference from curlew", 0.0, 5e-14},  // rounding
           {"Eq. A1 with ln as printed, % of positions not a number", 100.0, 0.0},
           {"Eq. A1 with ln|.|, of 8 corners and middles not a number", 8.0, 0.0},
           {"Eq. A1 with ln|.| and arctan at (.3, .2), alpha .7, beta 1", 3.079614607803, kSix},
           {"Eq. A1 with ln|.| and atan2 at (.3, .2), alpha .7, beta 1", -4.472026, kSix},
           {"intensity-weighted, round core", 3.0, kSix},
           {"intensity-weighted, round core, 3x3 sum", 5.7857, kFour},
           {"intensity-weighted, Fig. 7's core", 2.12, 0.005},
           {"intensity-weighted, Fig. 8's core", 1.15, 0.005},
           {"simulated spots, uniform amplitude", 4.23, kSpots},
           {"simulated spots, round core", 3.04, kSpots},
           {"simulated spots, Fig. 7's core", 2.12, kSpots},
           {"simulated spots, Fig. 8's core", 1.15, kSpots},
       }) {
    const auto found = rows.find(row.name);
    ASSERT_NE(found, rows.end()) << row.name << "\n" << said;
    EXPECT_NEAR(found->second, row.value, row.tolerance) << row.name;
  }
  for (const char* name : {"figure5.png", "figure6.png", "figure7.png", "figure8.png"}) {
    ASSERT_TRUE(std::filesystem::exists(scratch / name)) << name;
    EXPECT_GT(std::filesystem::file_size(scratch / name), 5000U) << name;
    EXPECT_LT(std::filesystem::file_size(scratch / name), 80000U) << name;
  }
}

}  // namespace
}  // namespace curlew
