#include "reconstruct/air/air_sums.h"

#include <algorithm>

namespace curlew {
namespace {

constexpr std::int64_t kKept = kLags.back() + 1;

/// Calls act(a, b) for all members that are summed up.
template <typename Act>
void for_each_member(AirSums& a, const AirSums& b, Act&& act) {
  act(a.frames, b.frames), act(a.seconds, b.seconds), act(a.steps, b.steps);
  act(a.pair_square, b.pair_square), act(a.pair_noise, b.pair_noise), act(a.pairs, b.pairs);
  act(a.mode_square, b.mode_square), act(a.mode_noise, b.mode_noise);
  act(a.mode_frames, b.mode_frames);
  act(a.light, b.light), act(a.light_square, b.light_square);
  act(a.light_noise, b.light_noise), act(a.light_count, b.light_count);
  act(a.slope_x, b.slope_x), act(a.slope_y, b.slope_y), act(a.slope_count, b.slope_count);
  act(a.slope_square, b.slope_square);
  for (std::size_t i = 0; i < kLags.size(); ++i) {
    act(a.products[i], b.products[i]);
    act(a.product_count[i], b.product_count[i]);
  }
  act(a.vortices, b.vortices), act(a.lenslets, b.lenslets), act(a.tracked, b.tracked);
  act(a.vortex_vx, b.vortex_vx), act(a.vortex_vy, b.vortex_vy);
}

/// Adds ½(a − b)² of both components, if both lenslets have slopes, and what noise adds to it.
void add_pair(const SlopeField& slopes, std::size_t a, std::size_t b, AirSums& sums) {
  if (slopes.valid[a] == 0 || slopes.valid[b] == 0) return;
  const auto half_square = [](float left, float right) {
    const double difference = static_cast<double>(left) - static_cast<double>(right);
    return 0.5 * difference * difference;
  };
  sums.pair_square += half_square(slopes.x[a], slopes.x[b]) + half_square(slopes.y[a], slopes.y[b]);
  sums.pair_noise += 0.5 * static_cast<double>(slopes.variance_x[a] + slopes.variance_x[b] +
                                               slopes.variance_y[a] + slopes.variance_y[b]);
  sums.pairs += 2;
}

}  // namespace

AirSums::AirSums(const AirPlan& plan)
    : mode_square(Eigen::ArrayXd::Zero(plan.mode_count())), mode_noise(mode_square) {
  const auto size = static_cast<Eigen::Index>(plan.lit().size());
  for (Eigen::ArrayXd* map :
       {&light, &light_square, &light_noise, &light_count, &slope_x, &slope_y, &slope_count})
    map->setZero(size);
  for (std::size_t i = 0; i < kLags.size(); ++i) {
    products[i].setZero(kMoves, kMoves);
    product_count[i].setZero(kMoves, kMoves);
  }
}

AirSums& AirSums::operator+=(const AirSums& more) {
  for_each_member(*this, more, [](auto& a, const auto& b) { a += b; });
  return *this;
}

AirSums& AirSums::operator-=(const AirSums& less) {
  for_each_member(*this, less, [](auto& a, const auto& b) { a -= b; });
  return *this;
}

AirCollector::AirCollector(const AirPlan& plan, const LightNoise& noise)
    : plan_(plan), noise_(noise), fit_(plan.modes()), kept_(kKept) {
  const int rows = plan.lit().rows();
  const int cols = plan.lit().cols();
  for (Kept& kept : kept_)
    kept = {-1, Image<float>(rows, cols), Image<float>(rows, cols), Image<float>(rows, cols)};
}

void AirCollector::add(const AirSample& sample, AirSums& sums) {
  ++sums.frames;
  if (newest_ >= 0 && sample.sequence > newest_ && sample.time_s > newest_s_) {
    sums.seconds += sample.time_s - newest_s_;
    sums.steps += sample.sequence - newest_;
  }
  newest_s_ = sample.time_s;
  newest_ = sample.sequence;
  add_pairs(sample.slopes, sums);
  add_modes(sample.slopes, sums);
  add_light(sample, sums);
  keep(sample, sums);
  // One lag a frame is enough, because what neighbouring frames say is much the same.
  add_products(next_lag_, sums);
  next_lag_ = (next_lag_ + 1) % kLags.size();
  sums.vortices += static_cast<std::int64_t>(sample.vortices.size());
  sums.lenslets += static_cast<double>(std::count(plan_.lit().begin(), plan_.lit().end(), 1));
  for (const Vortex& v : sample.vortices) {
    if (v.track < 0 || (v.flags & kVortexPredicted) != 0) continue;
    ++sums.tracked;
    sums.vortex_vx += static_cast<double>(v.velocity_x);
    sums.vortex_vy += static_cast<double>(v.velocity_y);
  }
}

void AirCollector::add_pairs(const SlopeField& slopes, AirSums& sums) const {
  const int apart = plan_.separation();
  const auto index = [&](int row, int col) {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(slopes.cols()) +
           static_cast<std::size_t>(col);
  };
  for (int row = 0; row < slopes.rows(); ++row)
    for (int col = 0; col < slopes.cols(); ++col) {
      if (col + apart < slopes.cols())
        add_pair(slopes, index(row, col), index(row, col + apart), sums);
      if (row + apart < slopes.rows())
        add_pair(slopes, index(row, col), index(row + apart, col), sums);
    }
}

void AirCollector::add_modes(const SlopeField& slopes, AirSums& sums) {
  const int count = plan_.mode_count();
  if (count == 0 || !fit_.fit(slopes)) return;
  ++sums.mode_frames;
  sums.mode_square += fit_.coefficients().segment(AirPlan::kFirstMode, count).array().square();
  sums.mode_noise += fit_.find_errors(slopes).segment(AirPlan::kFirstMode, count).array().square();
}

/// A spot that has faded away counts as dark; one that cannot be measured does not count.
void AirCollector::add_light(const AirSample& sample, AirSums& sums) const {
  for (std::size_t k = 0; k < sample.state.size(); ++k) {
    const LensletState state = sample.state[k];
    if (state != LensletState::kValid && state != LensletState::kFaint &&
        state != LensletState::kAtEdge)
      continue;
    const auto i = static_cast<Eigen::Index>(k);
    const auto light = static_cast<double>(sample.light_adu[k]);
    const auto area = static_cast<double>(sample.area_px[k]);
    if (area == 0.0) continue;
    sums.light[i] += light;
    sums.light_square[i] += light * light;
    sums.light_noise[i] += std::max(light, 0.0) * noise_.per_light + area * noise_.per_pixel;
    sums.light_count[i] += 1.0;
  }
}

void AirCollector::keep(const AirSample& sample, AirSums& sums) {
  const SlopeField& slopes = sample.slopes;
  Kept& kept = kept_[static_cast<std::size_t>(std::max<std::int64_t>(sample.sequence, 0) % kKept)];
  kept.sequence = sample.sequence;
  double mean_x = 0.0;
  double mean_y = 0.0;
  for (std::size_t k = 0; k < slopes.x.size(); ++k) {  // where it is not valid it is 0
    mean_x += static_cast<double>(slopes.x[k]);
    mean_y += static_cast<double>(slopes.y[k]);
  }
  const double n = std::max(1, slopes.n_valid);
  mean_x /= n;
  mean_y /= n;
  for (std::size_t k = 0; k < slopes.x.size(); ++k) {
    const bool valid = slopes.valid[k] != 0;
    const double x = valid ? static_cast<double>(slopes.x[k]) - mean_x : 0.0;
    const double y = valid ? static_cast<double>(slopes.y[k]) - mean_y : 0.0;
    kept.x[k] = static_cast<float>(x);
    kept.y[k] = static_cast<float>(y);
    kept.valid[k] = valid ? 1.0F : 0.0F;
    if (!valid) continue;
    const auto i = static_cast<Eigen::Index>(k);
    sums.slope_x[i] += x;
    sums.slope_y[i] += y;
    sums.slope_count[i] += 1.0;
    sums.slope_square +=
        x * x + y * y - static_cast<double>(slopes.variance_x[k] + slopes.variance_y[k]);
  }
}

const AirCollector::Kept* AirCollector::kept(std::int64_t sequence) const {
  if (sequence < 0) return nullptr;
  const Kept& kept = kept_[static_cast<std::size_t>(sequence % kKept)];
  return kept.sequence == sequence ? &kept : nullptr;
}

void AirCollector::add_products(std::size_t lag, AirSums& sums) const {
  const Kept* now = kept(newest_);
  const Kept* then = kept(newest_ - kLags[lag]);
  if (now == nullptr || then == nullptr) return;
  const int rows = now->x.rows();
  const int cols = now->x.cols();
  for (int down = -kFarthestMove; down <= kFarthestMove; ++down)
    for (int right = -kFarthestMove; right <= kFarthestMove; ++right) {
      double product = 0.0;
      double count = 0.0;
      const int first = std::max(0, -right);
      const int length = std::min(cols, cols - right) - first;
      for (int row = std::max(0, -down); row < std::min(rows, rows - down) && length > 0; ++row) {
        using Row = Eigen::Map<const Eigen::ArrayXf>;
        const auto old = [&](const Image<float>& map) { return Row(&map(row, first), length); };
        const auto moved = [&](const Image<float>& map) {
          return Row(&map(row + down, first + right), length);
        };
        product += static_cast<double>((old(then->x) * moved(now->x)).sum()) +
                   static_cast<double>((old(then->y) * moved(now->y)).sum());
        count += static_cast<double>((old(then->valid) * moved(now->valid)).sum());
      }
      sums.products[lag](down + kFarthestMove, right + kFarthestMove) += product;
      sums.product_count[lag](down + kFarthestMove, right + kFarthestMove) += count;
    }
}

}  // namespace curlew
