#include "service/bench/detection_score.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <string>

#include "acquisition/simulator/random_stream.h"

namespace curlew {
namespace {

constexpr Interior kInterior{16, 16};

SceneVortex vortex_at(double x, double y, int charge) { return {x, y, charge, 0.0, 0.0}; }
GradedVortex required_at(double x, double y, int charge) { return {x, y, charge, true, true}; }
GradedVortex excused_at(double x, double y, int charge) { return {x, y, charge, false, false}; }

std::vector<bool> required_of(const std::vector<SceneVortex>& vortices) {
  std::vector<bool> required;
  for (const GradedVortex& vortex : grade_vortices(vortices)) required.push_back(vortex.required);
  return required;
}

/// Returns frames of a few vortices at random places, far from one another.
std::vector<std::vector<GradedVortex>> random_truths(int frames, RandomStream& random) {
  std::vector<std::vector<GradedVortex>> truths(static_cast<std::size_t>(frames));
  for (auto& truth : truths) {
    for (int cell = 0; cell < 9; ++cell) {
      if (random.uniform() < 0.5) continue;
      truth.push_back(required_at(2.0 + 5.0 * (cell % 3) + random.uniform(),
                                  2.0 + 5.0 * (cell / 3) + random.uniform(),
                                  random.uniform() < 0.5 ? 1 : -1));
    }
  }
  return truths;
}

TEST(GradeVortices, TheClosestPairGoesFirst) {
  // + at 0, − at .9, + at 1.5: the last two are the closer pair, so the first one stays.
  EXPECT_EQ(required_of({vortex_at(5, 5, 1), vortex_at(5.9, 5, -1), vortex_at(6.5, 5, 1)}),
            (std::vector<bool>{true, false, false}));
  // In a row .9, .8 and .9 apart, the middle pair goes, and then nothing is nearer than 1.
  EXPECT_EQ(required_of({vortex_at(4, 5, 1), vortex_at(4.9, 5, -1), vortex_at(5.7, 5, 1),
                         vortex_at(6.6, 5, -1)}),
            (std::vector<bool>{true, false, false, true}));
  // If they are .8, .9 and .8 apart, both outer pairs go.
  EXPECT_EQ(required_of({vortex_at(4, 5, 1), vortex_at(4.8, 5, -1), vortex_at(5.7, 5, 1),
                         vortex_at(6.5, 5, -1)}),
            (std::vector<bool>(4, false)));
}

TEST(GradeVortices, EqualSignsAndDistancesOfOneAreNoPair) {
  EXPECT_EQ(required_of({vortex_at(5, 5, 1), vortex_at(5.1, 5, 1), vortex_at(6.1, 5, -1)}),
            (std::vector<bool>{true, true, true}));
  EXPECT_TRUE(grade_vortices({}).empty());
}

TEST(GradeVortices, IsolatedFromRemovedOnesToo) {
  const auto graded = grade_vortices(std::vector{vortex_at(5, 5, 1), vortex_at(6.8, 5, 1),
                                                 vortex_at(7.0, 5, -1), vortex_at(5, 9, -1)});
  EXPECT_FALSE(graded[0].isolated);
  EXPECT_FALSE(graded[2].isolated);
  EXPECT_TRUE(graded[3].isolated);
}

TEST(JudgeFrame, OneToOneByFallingScore) {
  const std::vector<GradedVortex> truth{required_at(5, 5, 1), required_at(5.5, 5, 1)};
  // The first by score takes the nearest, the next takes what is left, and the third is one too
  // many.
  const FrameVerdicts frame =
      judge_frame({{5.3, 5, 1, 1.0}, {5.2, 5, 1, 3.0}, {5.1, 5, 1, 2.0}}, truth, kInterior);
  ASSERT_EQ(frame.verdicts.size(), 3U);
  EXPECT_EQ(frame.required, 2);
  EXPECT_TRUE(frame.verdicts[0].hit);
  EXPECT_NEAR(frame.verdicts[0].error, 0.2, 1e-12);
  EXPECT_TRUE(frame.verdicts[1].hit);
  EXPECT_NEAR(frame.verdicts[1].error, 0.4, 1e-12);
  EXPECT_FALSE(frame.verdicts[2].hit);
}

TEST(JudgeFrame, SignAndDistanceMustFit) {
  const std::vector<GradedVortex> truth{required_at(5, 5, 1), required_at(9, 9, -1)};
  const FrameVerdicts frame =
      judge_frame({{5, 5, -1, 3.0}, {9, 9.76, -1, 2.0}, {5.5, 5.5, 1, 1.0}}, truth, kInterior);
  ASSERT_EQ(frame.verdicts.size(), 3U);
  EXPECT_FALSE(frame.verdicts[0].hit);
  EXPECT_FALSE(frame.verdicts[1].hit);
  EXPECT_TRUE(frame.verdicts[2].hit);
}

TEST(JudgeFrame, WhatIsNotRequiredExcusesAndIsNotHit) {
  const std::vector<GradedVortex> truth{excused_at(5, 5, 1), excused_at(5.5, 5, -1),
                                        required_at(6.2, 5, 1)};
  FrameVerdicts frame = judge_frame(
      {{5, 5, 1, 4.0}, {5.2, 5, 1, 3.0}, {5.4, 5, -1, 2.0}, {5, 6, 1, 1.0}}, truth, kInterior);
  EXPECT_EQ(frame.required, 1);
  ASSERT_EQ(frame.verdicts.size(), 1U) << "two of + and one of − are excused";
  EXPECT_FALSE(frame.verdicts[0].hit) << "it lies a pitch off and is a false alarm";
  // Candidates near both kinds hit the required vortex first, and then are excused.
  frame = judge_frame({{5.6, 5, 1, 2.0}, {5.7, 5, 1, 1.0}}, truth, kInterior);
  ASSERT_EQ(frame.verdicts.size(), 1U);
  EXPECT_TRUE(frame.verdicts[0].hit);
}

TEST(JudgeFrame, OutsideTheInteriorNothingCountsButAHitInside) {
  const std::vector<GradedVortex> truth{required_at(0.4, 5, 1), required_at(0.6, 9, 1)};
  const FrameVerdicts frame = judge_frame(
      {{0.4, 5, 1, 5.0}, {0.9, 5, 1, 4.0}, {0.3, 9, 1, 3.0}, {14.6, 3, 1, 2.0}, {14.4, 3, 1, 1.0}},
      truth, kInterior);
  EXPECT_EQ(frame.required, 1);
  ASSERT_EQ(frame.verdicts.size(), 2U);
  EXPECT_TRUE(frame.verdicts[0].hit);
  EXPECT_EQ(frame.verdicts[1].score, 1.0);
  EXPECT_FALSE(frame.verdicts[1].hit);
}

TEST(DetectionRecord, APerfectDetectorScoresOne) {
  constexpr std::uint64_t kSeed = 3;
  RandomStream random(kSeed, 0);
  std::vector<FrameVerdicts> frames;
  for (const auto& truth : random_truths(20, random)) {
    std::vector<Candidate> candidates;
    for (const GradedVortex& vortex : truth)
      candidates.push_back({vortex.x + 0.3, vortex.y - 0.4, vortex.charge, random.uniform()});
    frames.push_back(judge_frame(candidates, truth, kInterior));
  }
  const DetectionRecord record(frames);
  ASSERT_GT(record.required(), 40) << "seed " << kSeed;
  const DetectionScore score = record.score(record.best_threshold());
  EXPECT_EQ(score.f1, 1.0);
  EXPECT_EQ(score.best_f1, 1.0);
  EXPECT_NEAR(score.average_precision, 1.0, 1e-12);
  EXPECT_EQ(score.recall, 1.0);
  EXPECT_NEAR(score.rms, 0.5, 1e-12);
  EXPECT_NEAR(score.isolated_rms, 0.5, 1e-12);
}

/// Makes the verdicts of one frame from a text of + (hit) and - (false alarm), by falling score.
FrameVerdicts verdicts(const std::string& outcomes, int required) {
  FrameVerdicts frame;
  frame.required = required;
  double score = 100.0;
  for (const char outcome : outcomes)
    frame.verdicts.push_back({score--, outcome == '+', true, 0.1});
  return frame;
}

TEST(DetectionRecord, FiguresByHand) {
  const DetectionRecord record(std::vector{verdicts("++-+-", 4)});
  const DetectionScore score = record.score(99.0);
  EXPECT_NEAR(score.f1, 4.0 / 6.0, 1e-12);       // two found, two missed
  EXPECT_NEAR(score.best_f1, 6.0 / 8.0, 1e-12);  // three found, one false, one missed
  EXPECT_EQ(record.best_threshold(), 97.0);
  EXPECT_NEAR(score.average_precision, 0.25 * (1.0 + 1.0 + 0.75), 1e-12);
  EXPECT_EQ(score.recall, 0.5);
}

TEST(DetectionRecord, ARandomRankingHasThePrecisionOfChance) {
  constexpr std::uint64_t kSeed = 4;
  RandomStream random(kSeed, 0);
  std::vector<FrameVerdicts> frames(50);
  for (FrameVerdicts& frame : frames) {
    frame.required = 20;
    for (int i = 0; i < 80; ++i) frame.verdicts.push_back({random.uniform(), i < 20, false, 0.0});
  }
  // In the end all are found, which are a quarter of those named: the precision is .25 at every
  // recall. With 1000 hits and 3000 false alarms the average scatters by about .006.
  EXPECT_NEAR(DetectionRecord(frames).score(0.0).average_precision, 0.25, 0.03) << "seed " << kSeed;
}

TEST(DetectionRecord, EqualScoresStandOrFallTogether) {
  FrameVerdicts frame;
  frame.required = 2;
  frame.verdicts = {{1.0, true, false, 0.0}, {1.0, false, false, 0.0}, {1.0, true, false, 0.0}};
  const DetectionRecord record(std::vector{frame});
  const DetectionScore score = record.score(record.best_threshold());
  EXPECT_NEAR(score.average_precision, 2.0 / 3.0, 1e-12);
  EXPECT_NEAR(score.f1, 0.8, 1e-12);
  EXPECT_EQ(score.recall, 0.0);
}

TEST(DetectionRecord, RecallAtAFalseAlarmInTwentyFrames) {
  std::vector<FrameVerdicts> frames(20, verdicts("", 0));
  frames[0] = verdicts("+-+-+", 3);
  EXPECT_NEAR(DetectionRecord(frames).score(0.0).recall, 2.0 / 3.0, 1e-12);
  frames.pop_back();  // now one false alarm is too many
  EXPECT_NEAR(DetectionRecord(frames).score(0.0).recall, 1.0 / 3.0, 1e-12);
}

TEST(DetectionRecord, NothingRequiredOrNothingFound) {
  const DetectionRecord empty(std::vector{verdicts("--", 0)});
  EXPECT_TRUE(std::isnan(empty.score(0.0).f1));
  EXPECT_TRUE(std::isnan(empty.score(0.0).average_precision));
  const DetectionRecord blind(std::vector{verdicts("-", 3)});
  EXPECT_EQ(blind.best_threshold(), std::numeric_limits<double>::infinity());
  EXPECT_EQ(blind.score(blind.best_threshold()).f1, 0.0);
  EXPECT_EQ(blind.score(0.0).average_precision, 0.0);
  EXPECT_TRUE(std::isnan(blind.score(0.0).rms));
}

// Each frame finds a vortex with probability p = .7 and names nothing else: F1 = 2p/(1 + p).
TEST(DetectionRecord, BootstrapIntervalsCoverTheTruth) {
  constexpr std::uint64_t kSeed = 5;
  constexpr int kTrials = 200;
  constexpr double kFound = 0.7;
  RandomStream random(kSeed, 0);
  int covered = 0;
  for (int trial = 0; trial < kTrials; ++trial) {
    std::vector<FrameVerdicts> frames;
    for (int i = 0; i < 60; ++i)
      frames.push_back(verdicts(random.uniform() < kFound ? "+" : "", 1));
    const auto samples = DetectionRecord(frames).bootstrap(0.0, 200, kSeed);
    const Interval interval = interval_of(samples, &DetectionScore::f1);
    EXPECT_LT(interval.high - interval.low, 0.3);
    covered += interval.low <= 2.0 * kFound / (1.0 + kFound) &&
                       interval.high >= 2.0 * kFound / (1.0 + kFound)
                   ? 1
                   : 0;
  }
  // 95 % of 200 are 190. Percentile intervals of 60 frames are a little short, and chance adds ±6.
  EXPECT_GT(covered, 174) << "seed " << kSeed;
}

TEST(DetectionRecord, BootstrapsOfOneSeedDrawTheSameFrames) {
  std::vector<FrameVerdicts> a, b;
  for (int i = 0; i < 30; ++i) {
    a.push_back(verdicts(i % 3 == 0 ? "-" : "+", 1));
    b.push_back(verdicts(i % 3 == 0 ? "-" : "+-", 1));
  }
  const auto samples_a = DetectionRecord(a).bootstrap(0.0, 50, 7);
  const auto samples_b = DetectionRecord(b).bootstrap(0.0, 50, 7);
  for (std::size_t i = 0; i < samples_a.size(); ++i)
    EXPECT_GT(samples_a[i].f1, samples_b[i].f1) << "b must be worse than a in every single sample";
}

}  // namespace
}  // namespace curlew
