// Highway compiles this file once for every instruction set and chooses one at run time.
#include "detect/classifier/patch_layer.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstring>

#include "detect/classifier/classifier_network.h"
#include "detect/classifier/matrix_product.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "detect/classifier/patch_layer.cpp"
#include "hwy/foreach_target.h"
// Highway needs foreach_target.h before the headers below.

#include "detect/classifier/row_tiles-inl.h"
#include "hwy/contrib/math/math-inl.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace curlew::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

void round_all(const float* from, int n, std::int16_t* to) {
  for (int i = 0; i < n; ++i) {
    // With the arguments of min in this order, NaN becomes kMaxCode, too.
    to[i] = static_cast<std::int16_t>(
        std::min(static_cast<float>(kMaxCode), from[i] * kCodeSteps + 0.5F));
  }
}

void exponentials(const float* from, int n, float* to) {
  const hn::CappedTag<float, 16> d;
  const auto maximum = hn::Set(d, 20.0F);
  const auto minimum = hn::Set(d, -20.0F);
  for (int i = 0; i < n; i += static_cast<int>(hn::Lanes(d))) {
    const auto x = hn::Min(hn::Max(hn::LoadU(d, from + i), minimum), maximum);
    hn::StoreU(hn::Exp(d, x), d, to + i);
  }
}

#if HWY_TARGET == HWY_SCALAR

void multiply_all(const PatchLayer& layer, const std::int16_t* codes, std::ptrdiff_t row_step,
                  const std::int32_t* starts, int n, float* out) {
  for (int i = 0; i < n; ++i) {
    for (int output = 0; output < layer.outputs; ++output) {
      const std::int16_t* weight = layer.weights.data() + std::ptrdiff_t{2} * output;
      std::int32_t sum = 0;
      for (int row = 0; row < layer.rows; ++row) {
        const std::int16_t* code = codes + starts[i] + row * row_step;
        for (int k = 0; k < layer.row_codes; k += 2, weight += std::ptrdiff_t{2} * layer.outputs)
          sum += code[k] * weight[0] + code[k + 1] * weight[1];
      }
      const auto o = static_cast<std::size_t>(output);
      *out++ = std::max(static_cast<float>(sum) * layer.scale[o] + layer.bias[o], 0.0F);
    }
  }
}

#else

/// Multiplies kRows patches by 2 vectors of outputs, which stay in registers over the whole sum.
template <int kRows, class D>
HWY_INLINE void multiply_tile(D d, const PatchLayer& layer, int output, const std::int16_t* codes,
                              std::ptrdiff_t row_step, const std::int32_t* starts,
                              float* HWY_RESTRICT out) {
  const hn::RebindToSigned<D> to_sum;
  const hn::Repartition<std::int16_t, D> to_pairs;
  using Sum = hn::Vec<decltype(to_sum)>;
  using Pairs = hn::Vec<decltype(to_pairs)>;
  struct Tile {  // sums of even and odd codes, where the instruction set keeps them apart
    Sum left, left_odd, right, right_odd;
  };
  const auto lanes = static_cast<std::ptrdiff_t>(hn::Lanes(d));
  const Sum zero = hn::Zero(to_sum);
  Tile tile0{zero, zero, zero, zero};
  Tile tile1 = tile0, tile2 = tile0, tile3 = tile0, tile4 = tile0, tile5 = tile0;
  const std::int16_t* weight = layer.weights.data() + std::ptrdiff_t{2} * output;
  const std::ptrdiff_t weight_step = std::ptrdiff_t{2} * layer.outputs;
  for (int row = 0; row < layer.rows; ++row, codes += row_step) {
    for (int k = 0; k < layer.row_codes; k += 2, weight += weight_step) {
      const Pairs left = hn::LoadU(to_pairs, weight);
      const Pairs right = hn::LoadU(to_pairs, weight + 2 * lanes);
      const auto add = [&](int patch, Tile& tile) HWY_ATTR {
        std::int32_t pair = 0;
        std::memcpy(&pair, codes + starts[patch] + k, sizeof pair);
        const Pairs code = hn::BitCast(to_pairs, hn::Set(to_sum, pair));
        tile.left = hn::ReorderWidenMulAccumulate(to_sum, code, left, tile.left, tile.left_odd);
        tile.right = hn::ReorderWidenMulAccumulate(to_sum, code, right, tile.right, tile.right_odd);
      };
      add(0, tile0);
      if constexpr (kRows > 1) add(1, tile1);
      if constexpr (kRows > 2) add(2, tile2);
      if constexpr (kRows > 3) add(3, tile3);
      if constexpr (kRows > 4) add(4, tile4);
      if constexpr (kRows > 5) add(5, tile5);
    }
  }
  const auto finish = [&](Sum sum, Sum odd, std::ptrdiff_t column, float* to) HWY_ATTR {
    const auto total = hn::ConvertTo(d, hn::RearrangeToOddPlusEven(sum, odd));
    const auto value = hn::MulAdd(total, hn::LoadU(d, layer.scale.data() + column),
                                  hn::LoadU(d, layer.bias.data() + column));
    hn::StoreU(hn::Max(value, hn::Zero(d)), d, to + column);
  };
  const auto store = [&](int patch, const Tile& tile) HWY_ATTR {
    float* const to = out + std::ptrdiff_t{patch} * layer.outputs;
    finish(tile.left, tile.left_odd, output, to);
    finish(tile.right, tile.right_odd, output + lanes, to);
  };
  store(0, tile0);
  if constexpr (kRows > 1) store(1, tile1);
  if constexpr (kRows > 2) store(2, tile2);
  if constexpr (kRows > 3) store(3, tile3);
  if constexpr (kRows > 4) store(4, tile4);
  if constexpr (kRows > 5) store(5, tile5);
}

template <class D>
void multiply_outputs(D d, const PatchLayer& layer, int output, const std::int16_t* codes,
                      std::ptrdiff_t row_step, const std::int32_t* starts, int n, float* out) {
  in_row_tiles(n, [&](auto rows, int first) HWY_ATTR {
    multiply_tile<decltype(rows)::value>(d, layer, output, codes, row_step, starts + first,
                                         out + std::ptrdiff_t{first} * layer.outputs);
  });
}

void multiply_all(const PatchLayer& layer, const std::int16_t* codes, std::ptrdiff_t row_step,
                  const std::int32_t* starts, int n, float* out) {
  int output = 0;
  const auto part = [&](auto d) HWY_ATTR {
    const int width = 2 * static_cast<int>(hn::Lanes(d));
    for (; output + width <= layer.outputs; output += width)
      multiply_outputs(d, layer, output, codes, row_step, starts, n, out);
  };
  part(hn::CappedTag<float, 16>());
  part(hn::CappedTag<float, 8>());
  part(hn::CappedTag<float, 4>());
}

#endif

}  // namespace
}  // namespace curlew::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace curlew {
namespace {
HWY_EXPORT(round_all);
HWY_EXPORT(exponentials);
HWY_EXPORT(multiply_all);
}  // namespace

PatchLayer::PatchLayer(const DenseLayer& layer, int patch_rows)
    : rows(patch_rows),
      row_codes(layer.inputs / patch_rows),
      outputs(layer.outputs),
      weights(layer.weights.size()),
      scale(layer.bias.size()),
      bias(layer.bias) {
  assert(row_codes % 2 == 0 && rows * row_codes == layer.inputs && outputs % kProductColumns == 0);
  const auto columns = static_cast<std::size_t>(outputs);
  for (std::size_t column = 0; column < columns; ++column) {
    double sum = 0.0;
    double maximum = 0.0;
    for (std::size_t i = column; i < layer.weights.size(); i += columns) {
      const double size = std::abs(static_cast<double>(layer.weights[i]));
      sum += size;
      maximum = std::max(maximum, size);
    }
    constexpr double kMaxSum = 0x7FFFFFFF;
    constexpr double kMaxWeight = 0x7FFF;
    // Rounding adds at most ½ for each weight.
    const double room = kMaxSum / kMaxCode - 0.5 * layer.inputs;
    const double steps = std::min(room / std::max(sum, 1e-6), kMaxWeight / std::max(maximum, 1e-6));
    for (std::size_t i = 0; i < layer.weights.size() / columns; ++i) {
      weights[(i / 2 * columns + column) * 2 + i % 2] = static_cast<std::int16_t>(
          std::lround(steps * static_cast<double>(layer.weights[i * columns + column])));
    }
    scale[column] = static_cast<float>(1.0 / (steps * static_cast<double>(kCodeSteps)));
  }
}

void round_codes(const float* from, int n, std::int16_t* to) noexcept {
  HWY_DYNAMIC_DISPATCH(round_all)(from, n, to);
}

void take_exponentials(const float* from, int n, float* to) noexcept {
  assert(n % 16 == 0);
  HWY_DYNAMIC_DISPATCH(exponentials)(from, n, to);
}

void multiply_patches(const PatchLayer& layer, const std::int16_t* codes, std::ptrdiff_t row_step,
                      const std::int32_t* starts, int n, float* out) noexcept {
  HWY_DYNAMIC_DISPATCH(multiply_all)(layer, codes, row_step, starts, n, out);
}

}  // namespace curlew
#endif  // HWY_ONCE
