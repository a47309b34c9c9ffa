// Highway compiles the kernel of this file once for every instruction set and chooses one at run
// time.
#include "centroiding/slopes.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "centroiding/slopes.cpp"
#include "hwy/foreach_target.h"
// Highway needs foreach_target.h before the header below.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "core/size_check.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace curlew::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

/// Computes slopes a vector at a time, without branches. Every product and sum is rounded by
/// itself, so that all instruction sets give the same.
template <class D>
class SlopeKernel {
 public:
  using V = hn::Vec<D>;
  using M = hn::Mask<D>;

  /// `weak` gets the slopes of all spots, and `strict` those of valid spots. Either may be null.
  SlopeKernel(const SlopePlan& plan, const Centroids& centroids, SlopeField* weak,
              SlopeField* strict, bool subtract_low)
      : plan_(plan),
        centroids_(centroids),
        weak_(weak),
        strict_(strict),
        subtract_low_(subtract_low),
        sampled_(plan.sampling.empty()) {}

  /// Computes lenslets [begin, end). The last vector begins early enough to end with the last of
  /// them, so that end must be as many as it has lanes. Two vectors at a time share what is read of
  /// the plan.
  void run(std::size_t begin, std::size_t end) {
    const std::size_t lanes = hn::Lanes(D());
    for (std::size_t k = begin; k < end; k += 2 * lanes) {
      const std::size_t first = std::min(k, end - lanes);
      const std::size_t second = std::min(k + lanes, end - lanes);
      const Slopes a = measure(first);
      const Slopes b = measure(second);
      store(a, first);
      store(b, second);
    }
  }

 private:
  struct Slopes {
    V x, y, variance_x, variance_y, covariance_xy;
    V low_x, low_y;  ///< what the low orders add to x and y
    M valid;
    M any;  ///< valid or weak
  };

  static HWY_INLINE V set(float value) { return hn::Set(D(), value); }
  static HWY_INLINE V load(const Image<float>& map, std::size_t k) {
    return hn::LoadU(D(), map.data() + k);
  }
  static HWY_INLINE V only_if(M condition, V value) { return hn::IfThenElseZero(condition, value); }

  HWY_INLINE V true_px(const Image<float>& map, std::size_t k) const {
    if (sampled_) return load(map, k);
    HWY_ALIGN float values[hn::MaxLanes(D())];
    for (std::size_t i = 0; i < hn::Lanes(D()); ++i) values[i] = plan_.sampling.true_px(map[k + i]);
    return hn::Load(D(), values);
  }

  /// Returns the noise variance along an axis of a spot, px².
  HWY_INLINE V noise(V measured, M weak) const {
    const M narrow = hn::Not(hn::Gt(measured, hn::Zero(D())));
    return hn::IfThenElse(hn::And(weak, narrow), set(plan_.spot_variance_px2), measured);
  }

  /// Returns a·x + b·y and a·x + b·y + c·z.
  static HWY_INLINE V sum(float a, V x, float b, V y) {
    return hn::Add(hn::Mul(set(a), x), hn::Mul(set(b), y));
  }
  static HWY_INLINE V sum(float a, V x, float b, V y, float c, V z) {
    return hn::Add(sum(a, x, b, y), hn::Mul(set(c), z));
  }

  /// These are the plan's maps along an axis.
  struct AxisPlan {
    const Image<float>& ref_px;
    const Image<float>& off_px;
    const Image<float>& inverse_gain;
    const Image<float>& bend2;
    const Image<float>& bend3;
    const Image<float>& gain_error;
  };
  struct Axis {
    V displacement;        ///< px
    V variance;            ///< px²
    V true_over_measured;  ///< of a small step from where the spot lies
  };
  /// The curve is that of the window, so it applies to the displacement within the window. A dark
  /// lenslet's spot is most likely where those of the others are. `noise` is the variance of the
  /// measured place.
  HWY_INLINE Axis along(const AxisPlan& plan, const Image<float>& at_px,
                        const Image<float>& moved_px, const Image<float>& low_px, M has_spot,
                        M dark, V noise, std::size_t k) const {
    const V zero = hn::Zero(D());
    const V moved = only_if(has_spot, load(moved_px, k));
    const V q = hn::Sub(hn::Sub(true_px(at_px, k), load(plan.ref_px, k)), moved);
    V slope = load(plan.inverse_gain, k);
    V in_window = hn::Mul(q, slope);
    if (plan_.is_bent) {
      const V off = load(plan.off_px, k);
      const V reach = set(plan_.reach_px);
      const V near = hn::Sub(hn::Min(hn::Max(hn::Add(q, off), hn::Sub(zero, reach)), reach), off);
      const V bend2 = load(plan.bend2, k);
      const V bend3_near = hn::Mul(load(plan.bend3, k), near);
      const V steeper =
          hn::Mul(near, hn::Add(hn::Mul(set(2.0F), bend2), hn::Mul(set(3.0F), bend3_near)));
      in_window = hn::Add(in_window, hn::Mul(hn::Mul(near, near), hn::Add(bend2, bend3_near)));
      slope = hn::Max(hn::Add(slope, steeper), zero);
    }
    in_window = only_if(has_spot, in_window);
    slope = only_if(has_spot, slope);
    const V error = hn::Mul(load(plan.gain_error, k), in_window);
    return {hn::Add(in_window, hn::IfThenElse(dark, load(low_px, k), moved)),
            hn::Add(hn::Mul(hn::Mul(noise, slope), slope), hn::Mul(error, error)), slope};
  }

  HWY_INLINE Slopes measure(std::size_t k) const {
    const D d;
    const V zero = hn::Zero(d);
    const hn::Rebind<std::uint8_t, D> bytes;
    const hn::Rebind<std::int32_t, D> words;
    const auto* states = reinterpret_cast<const std::uint8_t*>(centroids_.state.data());
    const V state = hn::ConvertTo(d, hn::PromoteTo(words, hn::LoadU(bytes, states + k)));
    const auto is = [&](LensletState which)
                        HWY_ATTR { return hn::Eq(state, set(static_cast<float>(which))); };
    const M valid = is(LensletState::kValid);
    const M soft = hn::Or(is(LensletState::kFaint), is(LensletState::kAtEdge));
    const M lit = hn::Gt(load(centroids_.flux_adu, k), zero);
    const M weak = hn::And(soft, lit);
    const M dark = hn::AndNot(lit, soft);
    const M measured = hn::Or(valid, weak);

    const V low_x = load(centroids_.low_x_px, k);
    const V low_y = load(centroids_.low_y_px, k);
    const auto [dx, vx, gx] =
        along({plan_.ref_x_px, plan_.off_x_px, plan_.inverse_gain_x, plan_.bend2_x, plan_.bend3_x,
               plan_.gain_error_x},
              centroids_.x_px, centroids_.moved_x_px, centroids_.low_x_px, measured, dark,
              noise(load(centroids_.variance_x_px2, k), weak), k);
    const auto [dy, vy, gy] =
        along({plan_.ref_y_px, plan_.off_y_px, plan_.inverse_gain_y, plan_.bend2_y, plan_.bend3_y,
               plan_.gain_error_y},
              centroids_.y_px, centroids_.moved_y_px, centroids_.low_y_px, measured, dark,
              noise(load(centroids_.variance_y_px2, k), weak), k);
    const V c = hn::Mul(hn::Mul(load(centroids_.covariance_xy_px2, k), gx), gy);

    const float m11 = plan_.m11, m12 = plan_.m12, m21 = plan_.m21, m22 = plan_.m22;
    const V x = sum(m11, dx, m12, dy);
    const V y = sum(m21, dx, m22, dy);
    const V variance_x = sum(m11 * m11, vx, 2.0F * m11 * m12, c, m12 * m12, vy);
    const V variance_y = sum(m21 * m21, vx, 2.0F * m21 * m22, c, m22 * m22, vy);
    const V covariance = sum(m11 * m21, vx, m11 * m22 + m12 * m21, c, m12 * m22, vy);
    // A weak spot cannot be less well known than a dark one, which may be anywhere in its window.
    const V maximum = load(plan_.window_variance, k);
    const M lost = hn::And(weak, hn::Gt(hn::Max(variance_x, variance_y), maximum));
    const V of_dark = only_if(dark, maximum);
    const auto limited = [&](V variance) HWY_ATTR {
      const V least = hn::Min(variance, maximum);
      return hn::Add(of_dark, hn::IfThenElse(lost, least, variance));
    };
    const M any = hn::Or(valid, soft);
    return {x,
            y,
            limited(variance_x),
            limited(variance_y),
            hn::IfThenElse(lost, zero, covariance),
            sum(m11, only_if(any, low_x), m12, only_if(any, low_y)),
            sum(m21, only_if(any, low_x), m22, only_if(any, low_y)),
            valid,
            any};
  }

  HWY_INLINE void store(const Slopes& slopes, std::size_t k) const {
    if (strict_ != nullptr) store(slopes, slopes.x, slopes.y, slopes.valid, k, *strict_);
    if (weak_ == nullptr) return;
    const V x = subtract_low_ ? hn::Sub(slopes.x, slopes.low_x) : slopes.x;
    const V y = subtract_low_ ? hn::Sub(slopes.y, slopes.low_y) : slopes.y;
    store(slopes, x, y, slopes.any, k, *weak_);
  }
  static HWY_INLINE void store(const Slopes& slopes, V x, V y, M wanted, std::size_t k,
                               SlopeField& to) {
    const D d;
    hn::StoreU(only_if(wanted, x), d, to.x.data() + k);
    hn::StoreU(only_if(wanted, y), d, to.y.data() + k);
    hn::StoreU(only_if(wanted, slopes.variance_x), d, to.variance_x.data() + k);
    hn::StoreU(only_if(wanted, slopes.variance_y), d, to.variance_y.data() + k);
    hn::StoreU(only_if(wanted, slopes.covariance_xy), d, to.covariance_xy.data() + k);
  }

  const SlopePlan& plan_;
  const Centroids& centroids_;
  SlopeField* weak_;
  SlopeField* strict_;
  bool subtract_low_;
  bool sampled_;
};

/// Fills slopes.valid of lenslets [begin, end). Weak spots count if `with_weak`. There are no
/// branches, so that the compiler makes vectors of it.
void mark_valid(const Centroids& centroids, bool with_weak, std::size_t begin, std::size_t end,
                SlopeField& slopes) {
  const auto* state = reinterpret_cast<const std::uint8_t*>(centroids.state.data());
  const auto value = [](LensletState which) { return static_cast<std::uint8_t>(which); };
  const std::uint8_t valid = value(LensletState::kValid);
  const std::uint8_t faint = value(with_weak ? LensletState::kFaint : LensletState::kValid);
  const std::uint8_t at_edge = value(with_weak ? LensletState::kAtEdge : LensletState::kValid);
  std::uint8_t* to = slopes.valid.data();
  for (std::size_t k = begin; k < end; ++k) {
    const int counts = static_cast<int>(state[k] == valid) | static_cast<int>(state[k] == faint) |
                       static_cast<int>(state[k] == at_edge);
    to[k] = static_cast<std::uint8_t>(counts);
  }
}

/// Computes lenslet rows [first, last).
void measure(const SlopePlan& plan, const Centroids& centroids, int first, int last,
             SlopeField* weak, SlopeField* strict, bool subtract_low) {
  using Wide = hn::CappedTag<float, 16>;
  const auto cols = static_cast<std::size_t>(plan.ref_x_px.cols());
  const std::size_t begin = static_cast<std::size_t>(first) * cols;
  const std::size_t end = static_cast<std::size_t>(last) * cols;
  if (end >= hn::Lanes(Wide()))
    SlopeKernel<Wide>(plan, centroids, weak, strict, subtract_low).run(begin, end);
  else
    SlopeKernel<hn::CappedTag<float, 1>>(plan, centroids, weak, strict, subtract_low)
        .run(begin, end);
  if (weak != nullptr) mark_valid(centroids, true, begin, end, *weak);
  if (strict != nullptr) mark_valid(centroids, false, begin, end, *strict);
}

}  // namespace
}  // namespace curlew::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace curlew {
namespace {

HWY_EXPORT(measure);

/// Checks the sizes and computes both kinds of slopes of lenslet rows [first, last), or one kind
/// where the other is null.
void measure_both(const SlopePlan& plan, const Centroids& centroids, int first, int last,
                  SlopeField* weak, SlopeField* strict, bool subtract_low) noexcept {
  check_size("measure_slopes", "centroids", size_of(centroids.state), size_of(plan.ref_x_px));
  for (const SlopeField* slopes : {weak, strict})
    if (slopes != nullptr)
      check_size("measure_slopes", "slopes", size_of(*slopes), size_of(plan.ref_x_px));
  HWY_DYNAMIC_DISPATCH(measure)(plan, centroids, first, last, weak, strict, subtract_low);
}

/// Does the same for the whole array, and counts.
void measure_whole(const SlopePlan& plan, const Centroids& centroids, SlopeField* weak,
                   SlopeField* strict, bool subtract_low) noexcept {
  measure_both(plan, centroids, 0, plan.ref_x_px.rows(), weak, strict, subtract_low);
  for (SlopeField* slopes : {weak, strict})
    if (slopes != nullptr) count_slopes(*slopes);
}

}  // namespace

void measure_slopes(const SlopePlan& plan, const Centroids& centroids,
                    SlopeField& slopes) noexcept {
  measure_whole(plan, centroids, nullptr, &slopes, false);
}

void measure_weak_slopes(const SlopePlan& plan, const Centroids& centroids,
                         SlopeField& slopes) noexcept {
  measure_whole(plan, centroids, &slopes, nullptr, false);
}

void measure_all_slopes(const SlopePlan& plan, const Centroids& centroids, SlopeField& weak,
                        SlopeField& slopes) noexcept {
  measure_whole(plan, centroids, &weak, &slopes, true);
}

void measure_all_slopes_rows(const SlopePlan& plan, const Centroids& centroids, int first, int last,
                             SlopeField& weak, SlopeField& slopes) noexcept {
  measure_both(plan, centroids, first, last, &weak, &slopes, true);
}

void count_slopes(SlopeField& slopes) noexcept {
  int n_valid = 0;
  for (const std::uint8_t valid : slopes.valid) n_valid += valid;
  slopes.n_valid = n_valid;
}

void leave_out_weak(const Centroids& centroids, const SlopeField& weak,
                    SlopeField& slopes) noexcept {
  check_size("leave_out_weak", "centroids", size_of(centroids.state), size_of(weak));
  check_size("leave_out_weak", "slopes", size_of(slopes), size_of(weak));
  int n_valid = 0;
  for (std::size_t k = 0; k < weak.x.size(); ++k) {
    const bool valid = centroids.state[k] == LensletState::kValid;
    slopes.x[k] = valid ? weak.x[k] : 0.0F;
    slopes.y[k] = valid ? weak.y[k] : 0.0F;
    slopes.variance_x[k] = valid ? weak.variance_x[k] : 0.0F;
    slopes.variance_y[k] = valid ? weak.variance_y[k] : 0.0F;
    slopes.covariance_xy[k] = valid ? weak.covariance_xy[k] : 0.0F;
    slopes.valid[k] = valid ? 1 : 0;
    n_valid += valid ? 1 : 0;
  }
  slopes.n_valid = n_valid;
}

}  // namespace curlew
#endif  // HWY_ONCE
