#include "reconstruct/hidden_phase.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <random>
#include <vector>

#include "core/error.h"
#include "tests/support/analytic_slopes.h"
#include "tests/support/pupils.h"

namespace curlew {
namespace {

using testing::annular_pupil;
using testing::Mask;
using testing::square_pupil;

constexpr double kTwoPi = 2.0 * std::numbers::pi;

double wrapped(double phase) { return std::remainder(phase, kTwoPi); }

VortexList list_of(const std::vector<TestVortex>& vortices, float probability = 0.9F) {
  VortexList list(64);
  for (const TestVortex& v : vortices) {
    Vortex vortex;
    vortex.x = static_cast<float>(v.x);
    vortex.y = static_cast<float>(v.y);
    vortex.charge = v.charge;
    vortex.probability = probability;
    list.push(vortex);
  }
  return list;
}

/// Returns the slopes of the vortices and of a smooth phase, whose means over lenslets are written
/// out.
SlopeField slopes_of(const Mask& valid, const std::vector<TestVortex>& vortices) {
  SlopeField slopes = uniform_vortex_slopes(valid.rows(), valid.cols(), vortices);
  slopes.n_valid = 0;
  for (int r = 0; r < valid.rows(); ++r) {
    for (int c = 0; c < valid.cols(); ++c) {
      slopes.x(r, c) += 0.3F + 0.02F * static_cast<float>(c) + 0.03F * static_cast<float>(r);
      slopes.y(r, c) += -0.2F + 0.03F * static_cast<float>(c);
      slopes.valid(r, c) = valid(r, c);
      slopes.n_valid += valid(r, c);
      if (valid(r, c) == 0) slopes.x(r, c) = slopes.y(r, c) = 0.0F;
    }
  }
  return slopes;
}
double smooth_phase(double x, double y) { return 0.3 * x - 0.2 * y + 0.01 * x * x + 0.03 * x * y; }
double true_phase(const std::vector<TestVortex>& vortices, double x, double y) {
  double phase = smooth_phase(x, y);
  for (const TestVortex& v : vortices) phase += v.charge * std::atan2(y - v.y, x - v.x);
  return phase;
}

/// Takes one frame through split and hidden phase.
struct Frame {
  Frame(const Mask& valid, const SlopeField& slopes_in, const VortexList& candidates,
        const Image<float>& flux, const HiddenPhaseOptions& options = {},
        const SplitOptions& split_options = {}, std::size_t capacity = 64)
      : split_plan(valid, split_options),
        plan(split_plan, options, capacity),
        split_workspace(split_plan),
        workspace(plan),
        split(valid.rows(), valid.cols()),
        whole(valid.rows(), valid.cols()) {
    split_slopes(split_plan, slopes_in, split_workspace, split);
    add_hidden_phase(plan, candidates, slopes_in, flux, split, split_workspace, workspace, whole);
  }

  SplitPlan split_plan;
  HiddenPhasePlan plan;
  SplitWorkspace split_workspace;
  HiddenPhaseWorkspace workspace;
  HodgeSplit split;
  Image<float> whole;
};

Image<float> even_light(const Mask& valid) {
  return Image<float>(valid.rows(), valid.cols(), 100.0F);
}

/// Returns the rms of (whole − true) mod 2π, less its mean, over the lenslets farther than `beyond`
/// from every vortex. The mean is taken as a phasor.
double rms_error(const Frame& frame, const Mask& valid, const std::vector<TestVortex>& vortices,
                 double beyond) {
  std::complex<double> mean;
  const auto each = [&](auto use) {
    for (int r = 0; r < valid.rows(); ++r) {
      for (int c = 0; c < valid.cols(); ++c) {
        if (valid(r, c) == 0) continue;
        bool far = true;
        for (const TestVortex& v : vortices) far = far && std::hypot(c - v.x, r - v.y) > beyond;
        if (far) use(static_cast<double>(frame.whole(r, c)) - true_phase(vortices, c, r));
      }
    }
  };
  each([&](double error) { mean += std::polar(1.0, error); });
  double sum = 0.0;
  int n = 0;
  each([&](double error) {
    sum += std::pow(wrapped(error - std::arg(mean)), 2);
    ++n;
  });
  EXPECT_GT(n, 0);
  return std::sqrt(sum / n);
}

TEST(HiddenPhase, IsTheTruePhaseOfAPair) {
  const Mask valid = square_pupil(16);
  const std::vector<TestVortex> pair{{4.3, 6.6, 1}, {9.1, 8.2, -1}};
  const SlopeField slopes = slopes_of(valid, pair);
  const Frame frame(valid, slopes, list_of(pair), even_light(valid));
  ASSERT_EQ(frame.workspace.vortices.size(), 2U);
  // The softened slopes differ from the uniform means only next to the vortices.
  EXPECT_LT(rms_error(frame, valid, pair, 0.0), 0.06);
  EXPECT_LT(rms_error(frame, valid, pair, 2.0), 0.03);
  // Least squares alone is far off, and so is the vortices' phase added to it.
  Frame without(valid, slopes, list_of({}), even_light(valid));
  EXPECT_GT(rms_error(without, valid, pair, 2.0), 0.3);
  Frame twice(valid, slopes, list_of(pair), even_light(valid));
  for (std::size_t k = 0; k < twice.whole.size(); ++k)
    twice.whole[k] = twice.split.phase[k] + twice.workspace.rotational[k];
  EXPECT_GT(rms_error(twice, valid, pair, 2.0), 3.0 * rms_error(frame, valid, pair, 2.0));
}

TEST(HiddenPhase, IsTheTruePhaseOnAnObscuredPupilAlsoOfOneVortexAndWithWeights) {
  const Mask valid = annular_pupil(20, 0.3);
  SplitOptions weighted;
  weighted.weighted = true;
  for (const std::vector<TestVortex>& vortices :
       {std::vector<TestVortex>{{4.3, 9.1, 1}}, {{4.3, 9.1, 1}, {13.7, 12.2, -1}}}) {
    SlopeField slopes = slopes_of(valid, vortices);
    for (int r = 0; r < 20; ++r)
      for (int c = 0; c < 20; ++c)
        slopes.variance_x(r, c) = slopes.variance_y(r, c) = (r + c) % 3 == 0 ? 0.5F : 0.1F;
    for (const SplitOptions& options : {SplitOptions{}, weighted}) {
      const Frame frame(valid, slopes, list_of(vortices), even_light(valid), {}, options);
      ASSERT_EQ(frame.workspace.vortices.size(), vortices.size());
      EXPECT_LT(rms_error(frame, valid, vortices, 1.5), 0.06) << "weighted " << options.weighted;
      for (std::size_t k = 0; k < valid.size(); ++k)
        EXPECT_EQ(std::isnan(frame.whole[k]), valid[k] == 0);
    }
  }
}

TEST(HiddenPhase, WithoutVorticesIsLeastSquaresBitForBit) {
  const Mask valid = annular_pupil(12, 0.0);
  const SlopeField slopes = slopes_of(valid, {});
  VortexList unresolved = list_of({{5.0, 5.0, 1}});
  unresolved[0].charge = 0;
  for (const VortexList& nothing : {list_of({}), unresolved}) {
    const Frame frame(valid, slopes, nothing, even_light(valid));
    EXPECT_TRUE(frame.workspace.cuts.cuts.empty());
    for (std::size_t k = 0; k < valid.size(); ++k) {
      if (valid[k] != 0) {
        EXPECT_EQ(frame.whole[k], frame.split.phase[k]);
      }
    }
  }
}

TEST(HiddenPhase, ChoosesWhatTheSlopesSpeakFor) {
  const Mask valid = square_pupil(16);
  const std::vector<TestVortex> pair{{4.3, 6.6, 1}, {9.1, 8.2, -1}};
  const SlopeField slopes = slopes_of(valid, pair);
  // A doubtful half of the pair is believed. A probable candidate that does not exist is not.
  VortexList candidates = list_of({{4.3, 6.6, 1}, {12.5, 3.5, 1}, {9.1, 8.2, -1}});
  candidates[1].probability = 0.7F;
  candidates[2].probability = 0.1F;
  const Frame frame(valid, slopes, candidates, even_light(valid));
  ASSERT_EQ(frame.workspace.vortices.size(), 2U);
  EXPECT_EQ(frame.workspace.vortices[0].charge, 1);
  EXPECT_FLOAT_EQ(frame.workspace.vortices[0].x, 4.3F);
  EXPECT_EQ(frame.workspace.vortices[1].charge, -1);
  HiddenPhaseOptions trusting;
  trusting.choose = false;
  const Frame trusted(valid, slopes, candidates, even_light(valid), trusting);
  ASSERT_EQ(trusted.workspace.vortices.size(), 2U);
  EXPECT_FLOAT_EQ(trusted.workspace.vortices[1].x, 12.5F);
}

TEST(HiddenPhase, ChoosesOnArraysOfManyTilesToo) {
  const int n = 40;
  const Mask valid = square_pupil(n);
  std::mt19937 random(5);
  std::uniform_real_distribution<double> place(3.0, n - 7.0);
  std::vector<TestVortex> vortices;
  for (int i = 0; i < 5; ++i) {
    const double x = place(random);
    const double y = place(random);
    vortices.push_back({x, y, 1});
    vortices.push_back({x + 2.5, y + 0.7, -1});
  }
  SlopeField slopes = slopes_of(valid, vortices);
  std::normal_distribution<float> noise(0.0F, 0.1F);
  for (float& x : slopes.x) x += noise(random);
  for (float& y : slopes.y) y += noise(random);
  VortexList candidates(64);
  for (const Vortex& v : list_of(vortices, 0.3F)) candidates.push(v);
  for (const Vortex& v : list_of({{10.2, 33.1, 1}, {30.0, 4.4, -1}, {36.2, 20.0, 1}}, 0.7F))
    candidates.push(v);
  const Frame frame(valid, slopes, candidates, even_light(valid));
  ASSERT_EQ(frame.workspace.vortices.size(), vortices.size());
  for (std::size_t i = 0; i < vortices.size(); ++i)
    EXPECT_FLOAT_EQ(frame.workspace.vortices[i].x, static_cast<float>(vortices[i].x));
  EXPECT_LT(rms_error(frame, valid, vortices, 2.0), 0.15);
}

// One tile has more candidates than are solved side by side. Capacities end before, at and after a
// whole group.
TEST(HiddenPhase, ChoosesAmongManyInOneTile) {
  const int n = 24;
  const Mask valid = square_pupil(n);
  std::vector<TestVortex> vortices;
  std::vector<TestVortex> false_ones;
  for (int i = 0; i < 4; ++i) {
    for (int j = 0; j < 3; ++j) {
      const double x = 2.3 + 5.6 * i;
      const double y = 3.2 + 7.1 * j;
      vortices.push_back({x, y, (i + j) % 2 == 0 ? 1 : -1});
      false_ones.push_back({x - 0.6, y + 3.4, (i * j) % 2 == 0 ? 1 : -1});
      false_ones.push_back({x + 2.1, y + 2.8, (i * j) % 2 == 0 ? 1 : -1});
    }
  }
  const SlopeField slopes = slopes_of(valid, vortices);
  const VortexList true_candidates = list_of(vortices, 0.3F);
  const VortexList false_candidates = list_of(false_ones, 0.3F);
  for (const std::size_t capacity :
       {std::size_t{15}, std::size_t{16}, std::size_t{31}, std::size_t{36}}) {
    SCOPED_TRACE(capacity);
    VortexList candidates(capacity);
    // The true ones stand first, last and between, as far as there is room.
    for (std::size_t i = 0; i < false_ones.size() && candidates.size() + vortices.size() < capacity;
         ++i)
      candidates.push(false_candidates[i]);
    for (const Vortex& v : true_candidates) candidates.push(v);
    std::rotate(candidates.begin(), candidates.begin() + 7, candidates.end());
    ASSERT_EQ(candidates.size(), capacity);
    const Frame frame(valid, slopes, candidates, even_light(valid), {}, {}, capacity);
    const VortexList& chosen = frame.workspace.vortices;
    ASSERT_EQ(chosen.size(), vortices.size());
    for (const TestVortex& v : vortices) {
      EXPECT_TRUE(std::any_of(chosen.begin(), chosen.end(), [&](const Vortex& c) {
        return c.x == static_cast<float>(v.x) && c.y == static_cast<float>(v.y);
      }));
    }
  }
}

TEST(HiddenPhase, MirroredInputMirrorsOutput) {
  const Mask valid = square_pupil(13);
  const std::vector<TestVortex> vortices{{3.3, 4.6, 1}, {8.1, 6.2, -1}, {10.4, 9.7, 1}};
  const SlopeField slopes = slopes_of(valid, vortices);
  std::mt19937 random(3);
  std::exponential_distribution<float> light(0.01F);
  Image<float> flux(13, 13);
  for (float& f : flux) f = light(random);
  SlopeField mirrored = slopes;
  Image<float> mirrored_flux = flux;
  for (int r = 0; r < 13; ++r) {
    for (int c = 0; c < 13; ++c) {
      mirrored.x(r, c) = -slopes.x(r, 12 - c);
      mirrored.y(r, c) = slopes.y(r, 12 - c);
      mirrored_flux(r, c) = flux(r, 12 - c);
    }
  }
  std::vector<TestVortex> there;
  for (const TestVortex& v : vortices) there.push_back({12.0 - v.x, v.y, -v.charge});
  const Frame here(valid, slopes, list_of(vortices), flux);
  const Frame mirror(valid, mirrored, list_of(there), mirrored_flux);
  ASSERT_EQ(here.workspace.vortices.size(), 3U);
  EXPECT_EQ(mirror.workspace.vortices.size(), 3U);
  // Cuts of equal price may differ. The light that they cut is the same, and so is the phase except
  // for 2π.
  EXPECT_NEAR(here.workspace.cuts.light_cut, mirror.workspace.cuts.light_cut,
              0.2 * here.workspace.cuts.light_cut);
  const double piston = static_cast<double>(here.whole(0, 0) - mirror.whole(0, 12));
  for (int r = 0; r < 13; ++r)
    for (int c = 0; c < 13; ++c)
      EXPECT_NEAR(wrapped(static_cast<double>(here.whole(r, c) - mirror.whole(r, 12 - c)) - piston),
                  0.0, 2e-4);
}

TEST(HiddenPhase, FadedLensletsAreLeftOut) {
  const Mask valid = square_pupil(14);
  const std::vector<TestVortex> pair{{3.3, 6.6, 1}, {9.1, 8.2, -1}};
  SlopeField slopes = slopes_of(valid, pair);
  Mask left = valid;
  for (const auto& [r, c] : {std::pair{2, 9}, {11, 4}, {12, 12}}) {
    slopes.valid(r, c) = left(r, c) = 0;
    slopes.x(r, c) = slopes.y(r, c) = 0.0F;
    --slopes.n_valid;
  }
  const Frame frame(valid, slopes, list_of(pair), even_light(valid));
  ASSERT_EQ(frame.workspace.vortices.size(), 2U);
  EXPECT_TRUE(std::isnan(frame.whole(2, 9)));
  EXPECT_LT(rms_error(frame, left, pair, 2.0), 0.03);
}

TEST(HiddenPhase, MoreCandidatesThanFitAreCountedAndHarmNothing) {
  const Mask valid = square_pupil(12);
  const std::vector<TestVortex> pair{{3.3, 6.6, 1}, {8.1, 6.2, -1}};
  const SlopeField slopes = slopes_of(valid, pair);
  VortexList many(200);
  for (const Vortex& v : list_of(pair)) many.push(v);
  std::mt19937 random(9);
  std::uniform_real_distribution<float> place(-20.0F, 40.0F);
  for (int i = 0; i < 150; ++i) {
    Vortex v;
    v.x = place(random);
    v.y = place(random);
    v.charge = i % 2 == 0 ? 1 : -1;
    v.probability = 0.06F;
    many.push(v);
  }
  Vortex nowhere = many[0];
  nowhere.x = std::numeric_limits<float>::quiet_NaN();
  many.push(nowhere);
  for (const bool choose : {true, false}) {
    HiddenPhaseOptions options;
    options.choose = choose;
    const SplitPlan split_plan(valid, {});
    const HiddenPhasePlan plan(split_plan, options, 4);
    SplitWorkspace split_workspace(split_plan);
    HodgeSplit split(12, 12);
    split_slopes(split_plan, slopes, split_workspace, split);
    HiddenPhaseWorkspace workspace(plan);
    Image<float> whole(12, 12);
    add_hidden_phase(plan, many, slopes, even_light(valid), split, split_workspace, workspace,
                     whole);
    if (choose) {
      EXPECT_GT(workspace.choice.candidates.overflow(), 0);
    }
    ASSERT_EQ(workspace.vortices.size(), 2U);
    for (const float value : whole) EXPECT_TRUE(std::isfinite(value));
  }
}

TEST(HiddenPhase, RefusesOptionsOutOfRange) {
  const SplitPlan split_plan(square_pupil(4), {});
  HiddenPhaseOptions options;
  options.softening = 0.0F;
  EXPECT_THROW(HiddenPhasePlan(split_plan, options, 4), UsageError);
  options = {};
  options.choice.min_probability = 0.6F;
  EXPECT_THROW(HiddenPhasePlan(split_plan, options, 4), UsageError);
}

}  // namespace
}  // namespace curlew
