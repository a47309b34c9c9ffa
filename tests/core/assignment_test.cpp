#include "core/assignment.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "acquisition/simulator/random_stream.h"

namespace curlew {
namespace {

/// Returns the total gain of the best assignment, found by trying all.
double best_gain(const std::vector<std::vector<float>>& gain, std::size_t row,
                 std::vector<bool>& taken) {
  if (row == gain.size()) return 0.0;
  double best = best_gain(gain, row + 1, taken);
  for (std::size_t col = 0; col < taken.size(); ++col) {
    if (taken[col] || gain[row][col] <= 0.0F) continue;
    taken[col] = true;
    best = std::max(best, static_cast<double>(gain[row][col]) + best_gain(gain, row + 1, taken));
    taken[col] = false;
  }
  return best;
}

TEST(Assignment, IsTheBestOfAll) {
  constexpr std::uint64_t kSeed = 1;
  RandomStream random(kSeed, 0);
  Assignment assignment(7, 7, 7);
  for (int trial = 0; trial < 400; ++trial) {
    const auto rows = static_cast<std::size_t>(8.0 * random.uniform());
    const auto cols = static_cast<std::size_t>(8.0 * random.uniform());
    std::vector<std::vector<float>> gain(rows, std::vector<float>(cols, 0.0F));
    assignment.clear(rows, cols);
    for (std::size_t r = 0; r < rows; ++r) {
      for (std::size_t c = 0; c < cols; ++c) {
        if (random.uniform() < 0.5) gain[r][c] = static_cast<float>(random.uniform() - 0.1);
        assignment.allow(r, c, gain[r][c]);
      }
    }
    assignment.solve();
    double total = 0.0;
    std::vector<int> rows_of_col(cols, 0);
    for (std::size_t r = 0; r < rows; ++r) {
      const std::int32_t c = assignment.col_of_row()[r];
      if (c < 0) continue;
      ASSERT_GT(gain[r][static_cast<std::size_t>(c)], 0.0F);
      ASSERT_EQ(assignment.row_of_col()[static_cast<std::size_t>(c)], static_cast<std::int32_t>(r));
      ASSERT_EQ(++rows_of_col[static_cast<std::size_t>(c)], 1);
      total += static_cast<double>(gain[r][static_cast<std::size_t>(c)]);
    }
    std::vector<bool> taken(cols, false);
    ASSERT_NEAR(total, best_gain(gain, 0, taken), 1e-5) << "seed " << kSeed << ", trial " << trial;
  }
}

TEST(Assignment, OfMorePairsThanFitTheBestAreKept) {
  Assignment assignment(2, 5, 2);
  assignment.clear(2, 5);
  for (std::size_t c = 0; c < 5; ++c) {
    assignment.allow(0, c, c == 3 ? 9.0F : 1.0F + static_cast<float>(c));  // 1 2 3 9 5
    assignment.allow(1, c, c == 3 ? 9.0F : 0.0F);
  }
  assignment.solve();
  EXPECT_EQ(assignment.col_of_row()[0], 4);
  EXPECT_EQ(assignment.col_of_row()[1], 3);
}

}  // namespace
}  // namespace curlew
