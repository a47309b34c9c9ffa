#include "service/bench/split_benchmark.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <random>

#include "acquisition/simulator/simulator_options.h"
#include "core/as_size.h"
#include "reconstruct/split.h"
#include "service/bench/plain_centroid.h"
#include "service/bench/plain_split.h"

namespace curlew {
namespace {

constexpr int kFrames = 8;
constexpr std::size_t kWindowPixels = 100;
constexpr float kSplitNoise = 0.3F;  // rad a pitch
constexpr float kVariance = 0.09F;   // of a lenslet of mean flux

int count_faded(SplitDisturbance disturbance, std::size_t lit) {
  const auto part = [&](double of) {
    return std::max(1, static_cast<int>(std::lround(of * static_cast<double>(lit))));
  };
  switch (disturbance) {
    case SplitDisturbance::kOneFaded:
      return 1;
    case SplitDisturbance::kOnePercentFaded:
      return part(0.01);
    case SplitDisturbance::kFivePercentFaded:
    case SplitDisturbance::kCrossesFaded:
      return part(0.05);
    default:
      return 0;
  }
}

/// Lets n lit lenslets fade, at the first of `places`, or in crosses about these.
void fade(Image<std::uint8_t>& valid, const std::vector<std::size_t>& places, int n,
          bool in_crosses) {
  const auto fade_one = [&](int row, int col) {
    if (n == 0 || !valid.contains(row, col) || valid(row, col) == 0) return;
    valid(row, col) = 0;
    --n;
  };
  for (const std::size_t k : places) {
    const int row = static_cast<int>(k) / valid.cols();
    const int col = static_cast<int>(k) % valid.cols();
    fade_one(row, col);
    if (!in_crosses) continue;
    for (const int step : {-1, 1}) {
      fade_one(row + step, col);
      fade_one(row, col + step);
    }
  }
}

/// Returns the largest difference of a component of the curl-free slopes from the truth.
template <typename Scalar>
double largest_difference(const Image<Scalar>& x, const Image<Scalar>& y,
                          const PlainSplit<double>& truth) {
  double largest = 0.0;
  for (std::size_t k = 0; k < x.size(); ++k) {
    largest = std::max({largest, std::abs(static_cast<double>(x[k]) - truth.curl_free_x()[k]),
                        std::abs(static_cast<double>(y[k]) - truth.curl_free_y()[k])});
  }
  return largest;
}

double largest_slope(const SlopeField& slopes) {
  double largest = 0.0;
  for (std::size_t k = 0; k < slopes.x.size(); ++k) {
    largest = std::max({largest, std::abs(static_cast<double>(slopes.x[k])),
                        std::abs(static_cast<double>(slopes.y[k]))});
  }
  return largest;
}

/// Holds frames of one pupil and one disturbance, and all that splits them.
class SplitTrial {
 public:
  SplitTrial(const Image<std::uint8_t>& pupil, SplitDisturbance disturbance)
      : disturbance_(disturbance),
        weighted_(disturbance == SplitDisturbance::kWeighted),
        plan_(pupil, {.weighted = weighted_}),
        workspace_(plan_),
        split_(pupil.rows(), pupil.cols()),
        plain_float_(pupil),
        plain_double_(pupil),
        plain_kept_(pupil),
        pixels_(pupil.size() * kWindowPixels) {
    for (int i = 0; i < kFrames; ++i)
      frames_.push_back(disturbed_slopes(pupil, disturbance, static_cast<std::uint64_t>(i) + 1));
  }

  SplitTimes time(int rounds) {
    SplitTimes result;
    result.disturbance = disturbance_;
    check_answers(result);
    const auto advance = [this] { current_ = (current_ + 1) % frames_.size(); };
    const auto split = [this] { split_slopes(plan_, frames_[current_], workspace_, split_); };
    std::vector<TimedRun> runs{{advance, split},
                               {split, split},
                               {{}, [this] { solve_anew(plain_float_); }},
                               {{}, [this] { solve_anew(plain_double_); }},
                               {[this] { read(); }, [this] { read(); }}};
    if (disturbance_ == SplitDisturbance::kNone) {
      plain_kept_.factorise(frames_[0], weighted_);
      runs.push_back({{}, [this] { plain_kept_.solve(frames_[current_]); }});
    }
    const std::vector<RoundTimes> times = time_in_turn(runs, rounds);
    result.cold = times[0];
    result.warm = times[1];
    result.plain_float = times[2];
    result.plain_double = times[3];
    result.read = times[4];
    if (times.size() > 5) result.plain_kept = times[5];
    return result;
  }

 private:
  void read() {
    sum_ = sum_pixels(PlainBuild::kPortable, pixels_.data(),
                      static_cast<std::int64_t>(pixels_.size()));
  }
  template <typename Scalar>
  void solve_anew(PlainSplit<Scalar>& plain, int refinements = 0) {
    plain.factorise(frames_[current_], weighted_);
    plain.solve(frames_[current_], refinements);
  }

  void check_answers(SplitTimes& result) {
    for (current_ = 0; current_ < frames_.size(); ++current_) {
      const SlopeField& slopes = frames_[current_];
      split_slopes(plan_, slopes, workspace_, split_);
      solve_anew(plain_float_);
      solve_anew(plain_double_, 1);
      const double scale = 1.0 / largest_slope(slopes);
      const auto raise = [&](double& worst, double error) {
        worst = std::max(worst, error * scale);
      };
      raise(result.worst_error,
            largest_difference(split_.curl_free_x, split_.curl_free_y, plain_double_));
      raise(result.plain_float_error,
            largest_difference(plain_float_.curl_free_x(), plain_float_.curl_free_y(),
                               plain_double_));
      result.iterations = std::max(result.iterations, split_.iterations);
      result.converged = result.converged && split_.converged;
    }
    current_ = 0;
  }

  SplitDisturbance disturbance_;
  bool weighted_;
  SplitPlan plan_;
  SplitWorkspace workspace_;
  HodgeSplit split_;
  PlainSplit<float> plain_float_;
  PlainSplit<double> plain_double_;
  PlainSplit<float> plain_kept_;
  std::vector<std::uint16_t> pixels_;
  volatile std::uint64_t sum_ = 0;  // keeps the compiler from leaving the reading out
  std::vector<SlopeField> frames_;
  std::size_t current_ = 0;
};

}  // namespace

const char* name_of(SplitDisturbance disturbance) {
  switch (disturbance) {
    case SplitDisturbance::kOneFaded:
      return "one_faded";
    case SplitDisturbance::kOnePercentFaded:
      return "one_percent_faded";
    case SplitDisturbance::kFivePercentFaded:
      return "five_percent_faded";
    case SplitDisturbance::kCrossesFaded:
      return "crosses_faded";
    case SplitDisturbance::kWeighted:
      return "weighted";
    default:
      return "none_faded";
  }
}

Image<std::uint8_t> obscured_pupil(int rows, int cols) {
  SimulatorOptions options;
  options.rows = rows;
  options.cols = cols;
  options.pupil = PupilShape::kObscured;
  options.obscuration = 0.28;
  return find_lit_lenslets(options);
}

SlopeField disturbed_slopes(const Image<std::uint8_t>& pupil, SplitDisturbance disturbance,
                            std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<float> noise(0.0F, kSplitNoise);
  std::exponential_distribution<float> flux(1.0F);
  SlopeField slopes(pupil.rows(), pupil.cols());
  slopes.valid = pupil;
  std::vector<std::size_t> lit;
  for (std::size_t k = 0; k < pupil.size(); ++k)
    if (pupil[k] != 0) lit.push_back(k);
  std::shuffle(lit.begin(), lit.end(), random);
  fade(slopes.valid, lit, count_faded(disturbance, lit.size()),
       disturbance == SplitDisturbance::kCrossesFaded);
  for (int r = 0; r < pupil.rows(); ++r) {
    for (int c = 0; c < pupil.cols(); ++c) {
      if (slopes.valid(r, c) == 0) continue;
      slopes.x(r, c) = std::sin(0.1F * static_cast<float>(c)) + noise(random);
      slopes.y(r, c) = std::cos(0.07F * static_cast<float>(r)) + noise(random);
      const float light = disturbance == SplitDisturbance::kWeighted ? 0.05F + flux(random) : 1.0F;
      slopes.variance_x(r, c) = slopes.variance_y(r, c) = kVariance / light;
      ++slopes.n_valid;
    }
  }
  return slopes;
}

SplitBenchmark time_splits(int rows, int cols, int rounds, const std::function<void()>& step) {
  const Image<std::uint8_t> pupil = obscured_pupil(rows, cols);
  SplitBenchmark result{.rows = rows, .cols = cols, .lit = 0, .frames = kFrames, .times = {}};
  result.lit = static_cast<int>(std::count(pupil.begin(), pupil.end(), 1));
  for (const SplitDisturbance disturbance : kSplitDisturbances) {
    result.times.push_back(SplitTrial(pupil, disturbance).time(rounds));
    step();
  }
  return result;
}

}  // namespace curlew
