// Highway compiles this file once for every instruction set and chooses one at run time.
#include "reconstruct/vortex_field.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "reconstruct/vortex_field.cpp"
#include "hwy/foreach_target.h"
// Highway needs foreach_target.h before the header below.

#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace curlew::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

/// Returns the arctangent of y/x in the right quadrant, within 2e-5, and 0 where both are 0. The
/// polynomial is of degree 11 on [0, 1] (Hastings, Approximations for Digital Computers, 1955).
template <class D, class V = hn::Vec<D>>
HWY_INLINE V arctan2(D d, V y, V x) {
  const V ax = hn::Abs(x);
  const V ay = hn::Abs(y);
  const V larger = hn::Max(hn::Max(ax, ay), hn::Set(d, 1e-37F));
  const V t = hn::Div(hn::Min(ax, ay), larger);
  const V t2 = hn::Mul(t, t);
  V p = hn::MulAdd(t2, hn::Set(d, -0.01172120F), hn::Set(d, 0.05265332F));
  p = hn::MulAdd(t2, p, hn::Set(d, -0.11643287F));
  p = hn::MulAdd(t2, p, hn::Set(d, 0.19354346F));
  p = hn::MulAdd(t2, p, hn::Set(d, -0.33262347F));
  p = hn::Mul(t, hn::MulAdd(t2, p, hn::Set(d, 0.99997726F)));
  p = hn::IfThenElse(hn::Gt(ay, ax), hn::Sub(hn::Set(d, 1.57079633F), p), p);
  p = hn::IfThenElse(hn::Lt(x, hn::Zero(d)), hn::Sub(hn::Set(d, 3.14159265F), p), p);
  return hn::CopySign(p, y);
}

void evaluate_all(const PointVortex* vortices, std::size_t n, float softening, int rows, int cols,
                  float* phase, float* slope_x, float* slope_y) {
  const hn::ScalableTag<float> d;
  using V = hn::Vec<decltype(d)>;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const V soft = hn::Set(d, softening);
  for (int row = 0; row < rows; ++row) {
    for (int col = 0; col < cols; col += lanes) {
      const V x = hn::Iota(d, static_cast<float>(col));
      V re = hn::Set(d, 1.0F);  // product of unit phasors, whose arguments add up
      V im = hn::Zero(d);
      V gx = hn::Zero(d);
      V gy = hn::Zero(d);
      for (std::size_t v = 0; v < n; ++v) {
        const float dy_here = static_cast<float>(row) - vortices[v].y;
        const V charge = hn::Set(d, vortices[v].charge);
        const V dx = hn::Sub(x, hn::Set(d, vortices[v].x));
        const V dy = hn::Set(d, vortices[v].charge * dy_here);
        const V r2 = hn::MulAdd(dx, dx, hn::MulAdd(dy, dy, soft));
        V inverse = hn::ApproximateReciprocalSqrt(r2);
        inverse = hn::Mul(inverse, hn::NegMulAdd(hn::Mul(hn::Set(d, 0.5F), r2),
                                                 hn::Mul(inverse, inverse), hn::Set(d, 1.5F)));
        const V inverse2 = hn::Mul(inverse, inverse);
        gx = hn::NegMulAdd(dy, inverse2, gx);
        gy = hn::MulAdd(hn::Mul(charge, dx), inverse2, gy);
        const V u = hn::Mul(dx, inverse);  // It is shorter than 1, for r2 holds the softening.
        const V w = hn::Mul(dy, inverse);
        const V turned = hn::NegMulAdd(im, w, hn::Mul(re, u));
        im = hn::MulAdd(re, w, hn::Mul(im, u));
        re = turned;
      }
      const V angle = arctan2(d, im, re);
      float* const to_phase = phase + std::ptrdiff_t{row} * cols + col;
      float* const to_x = slope_x + std::ptrdiff_t{row} * cols + col;
      float* const to_y = slope_y + std::ptrdiff_t{row} * cols + col;
      if (col + lanes <= cols) {
        hn::StoreU(angle, d, to_phase);
        hn::StoreU(gx, d, to_x);
        hn::StoreU(gy, d, to_y);
      } else {
        HWY_ALIGN float rest[hn::MaxLanes(d)];
        const auto store = [&](V from, float* to) HWY_ATTR {
          hn::Store(from, d, rest);
          for (int i = 0; i < cols - col; ++i) to[i] = rest[i];
        };
        store(angle, to_phase);
        store(gx, to_x);
        store(gy, to_y);
      }
    }
  }
}

}  // namespace
}  // namespace curlew::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace curlew {
namespace {
HWY_EXPORT(evaluate_all);
}  // namespace

void evaluate_vortices(const PointVortex* vortices, std::size_t n, float softening,
                       Image<float>& phase, Image<float>& slope_x, Image<float>& slope_y) noexcept {
  HWY_DYNAMIC_DISPATCH(evaluate_all)
  (vortices, n, softening, phase.rows(), phase.cols(), phase.data(), slope_x.data(),
   slope_y.data());
}

}  // namespace curlew
#endif  // HWY_ONCE
