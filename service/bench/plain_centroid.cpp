#include "service/bench/plain_centroid.h"

#include <cstddef>
#include <cstring>

#if defined(__x86_64__)
#define CURLEW_FOR_AVX2 __attribute__((target("avx2,fma")))
#define CURLEW_FOR_AVX512 __attribute__((target("avx512f,avx512bw,avx512dq,avx512vl,avx2,fma")))
#else
#define CURLEW_FOR_AVX2
#define CURLEW_FOR_AVX512
#endif

namespace curlew {
namespace {

/// The loops below are inlined into one function for each instruction set, which is how they come
/// to be compiled for it.
#define CURLEW_INLINED [[gnu::always_inline]] inline

template <typename Pixel>
CURLEW_INLINED float signal_of(const PlainFrame<Pixel>& frame, std::ptrdiff_t i) {
  const float v = static_cast<float>(frame.pixels[i]) * frame.gain[i] - frame.offset[i];
  return v > 0.0F ? v : 0.0F;
}

CURLEW_INLINED void store(const PlainCentroids& out, std::ptrdiff_t k, float first_x, float first_y,
                          float sum, float sum_x, float sum_y) {
  const float inverse = sum > 0.0F ? 1.0F / sum : 0.0F;
  out.flux[k] = sum;
  out.x_px[k] = first_x + sum_x * inverse;
  out.y_px[k] = first_y + sum_y * inverse;
}

/// kSide is the side of the windows if the compiler knows it, which then unrolls the loop along a
/// row, and else 0.
template <int kSide, typename Pixel>
CURLEW_INLINED void walk_windows(const PlainFrame<Pixel>& frame, const PlainCentroids& out) {
  const int side = kSide > 0 ? kSide : frame.window_px;
  const std::ptrdiff_t stride = static_cast<std::ptrdiff_t>(frame.cols) * side;
  for (int row = 0; row < frame.rows; ++row) {
    for (int col = 0; col < frame.cols; ++col) {
      std::ptrdiff_t start = stride * row * side + static_cast<std::ptrdiff_t>(col) * side;
      float sum = 0.0F;
      float sum_x = 0.0F;
      float sum_y = 0.0F;
      for (int y = 0; y < side; ++y, start += stride) {
        float row_sum = 0.0F;
        float row_sum_x = 0.0F;
        for (int x = 0; x < side; ++x) {
          const float v = signal_of(frame, start + x);
          row_sum += v;
          row_sum_x += v * static_cast<float>(x);
        }
        sum += row_sum;
        sum_x += row_sum_x;
        sum_y += row_sum * static_cast<float>(y);
      }
      store(out, static_cast<std::ptrdiff_t>(row) * frame.cols + col,
            static_cast<float>(col * side), static_cast<float>(row * side), sum, sum_x, sum_y);
    }
  }
}

template <typename Pixel>
CURLEW_INLINED void walk_windows_of_any_side(const PlainFrame<Pixel>& frame,
                                             const PlainCentroids& out) {
  switch (frame.window_px) {
    case 6:
      return walk_windows<6>(frame, out);
    case 8:
      return walk_windows<8>(frame, out);
    case 10:
      return walk_windows<10>(frame, out);
    case 12:
      return walk_windows<12>(frame, out);
    case 16:
      return walk_windows<16>(frame, out);
    case 32:
      return walk_windows<32>(frame, out);
    default:
      return walk_windows<0>(frame, out);
  }
}

/// Rows of pixels are long enough to fill vectors of any width. Only the sums of the columns are
/// then taken apart into windows, once a row of lenslets.
template <typename Pixel>
CURLEW_INLINED void walk_rows(const PlainFrame<Pixel>& frame, const PlainCentroids& out) {
  const int side = frame.window_px;
  const std::ptrdiff_t stride = static_cast<std::ptrdiff_t>(frame.cols) * side;
  float* __restrict column = out.column_sum;
  float* __restrict column_y = out.column_sum + stride;
  for (int row = 0; row < frame.rows; ++row) {
    for (std::ptrdiff_t x = 0; x < stride; ++x) column[x] = column_y[x] = 0.0F;
    for (int y = 0; y < side; ++y) {
      const std::ptrdiff_t start = stride * (static_cast<std::ptrdiff_t>(row) * side + y);
      for (std::ptrdiff_t x = 0; x < stride; ++x) {
        const float v = signal_of(frame, start + x);
        column[x] += v;
        column_y[x] += v * static_cast<float>(y);
      }
    }
    for (int col = 0; col < frame.cols; ++col) {
      const std::ptrdiff_t first = static_cast<std::ptrdiff_t>(col) * side;
      float sum = 0.0F;
      float sum_x = 0.0F;
      float sum_y = 0.0F;
      for (int x = 0; x < side; ++x) {
        sum += column[first + x];
        sum_x += column[first + x] * static_cast<float>(x);
        sum_y += column_y[first + x];
      }
      store(out, static_cast<std::ptrdiff_t>(row) * frame.cols + col,
            static_cast<float>(col * side), static_cast<float>(row * side), sum, sum_x, sum_y);
    }
  }
}

template <typename Pixel>
CURLEW_INLINED void walk(PlainOrder order, const PlainFrame<Pixel>& frame,
                         const PlainCentroids& out) {
  if (order == PlainOrder::kRows)
    walk_rows(frame, out);
  else
    walk_windows_of_any_side(frame, out);
}

/// Words of several pixels are summed as they are, every other pixel at a time, so that each has
/// its neighbour's bits to grow into; after kBlock words these would overflow.
template <typename Pixel>
CURLEW_INLINED std::uint64_t sum(const Pixel* pixels, std::int64_t n) {
  constexpr std::int64_t kPixels = sizeof(std::uint64_t) / sizeof(Pixel);
  constexpr unsigned kBits = 8 * sizeof(Pixel);
  constexpr std::int64_t kBlock = std::int64_t{1} << (kBits - 1);
  constexpr std::uint64_t kEven = sizeof(Pixel) == 1 ? 0x00FF00FF00FF00FF : 0x0000FFFF0000FFFF;
  const std::int64_t words = n / kPixels;
  std::uint64_t total = 0;
  for (std::int64_t start = 0; start < words; start += kBlock) {
    const std::int64_t end = words - start < kBlock ? words : start + kBlock;
    std::uint64_t block = 0;
    for (std::int64_t i = start; i < end; ++i) {
      std::uint64_t word = 0;
      std::memcpy(&word, pixels + i * kPixels, sizeof word);
      block += (word & kEven) + ((word >> kBits) & kEven);
    }
    for (; block != 0; block >>= 2 * kBits) total += block & ((std::uint64_t{1} << 2 * kBits) - 1);
  }
  for (std::int64_t i = words * kPixels; i < n; ++i) total += pixels[i];
  return total;
}

template <typename Pixel>
void walk_portable(PlainOrder order, const PlainFrame<Pixel>& frame, const PlainCentroids& out) {
  walk(order, frame, out);
}
template <typename Pixel>
CURLEW_FOR_AVX2 void walk_avx2(PlainOrder order, const PlainFrame<Pixel>& frame,
                               const PlainCentroids& out) {
  walk(order, frame, out);
}
template <typename Pixel>
CURLEW_FOR_AVX512 void walk_avx512(PlainOrder order, const PlainFrame<Pixel>& frame,
                                   const PlainCentroids& out) {
  walk(order, frame, out);
}

template <typename Pixel>
std::uint64_t sum_portable(const Pixel* pixels, std::int64_t n) {
  return sum(pixels, n);
}
template <typename Pixel>
CURLEW_FOR_AVX2 std::uint64_t sum_avx2(const Pixel* pixels, std::int64_t n) {
  return sum(pixels, n);
}
template <typename Pixel>
CURLEW_FOR_AVX512 std::uint64_t sum_avx512(const Pixel* pixels, std::int64_t n) {
  return sum(pixels, n);
}

}  // namespace

const char* name_of(PlainBuild build) noexcept {
  switch (build) {
    case PlainBuild::kAvx512:
      return "avx512";
    case PlainBuild::kAvx2:
      return "avx2";
    default:
      return "portable";
  }
}

bool can_run(PlainBuild build) noexcept {
#if defined(__x86_64__)
  const bool avx2 = __builtin_cpu_supports("avx2") != 0 && __builtin_cpu_supports("fma") != 0;
  if (build == PlainBuild::kAvx2) return avx2;
  if (build == PlainBuild::kAvx512) {
    return avx2 && __builtin_cpu_supports("avx512f") != 0 &&
           __builtin_cpu_supports("avx512bw") != 0 && __builtin_cpu_supports("avx512dq") != 0 &&
           __builtin_cpu_supports("avx512vl") != 0;
  }
#endif
  return build == PlainBuild::kPortable;
}

template <typename Pixel>
void find_plain_centroids(PlainBuild build, PlainOrder order, const PlainFrame<Pixel>& frame,
                          const PlainCentroids& centroids) noexcept {
  switch (build) {
    case PlainBuild::kAvx512:
      return walk_avx512(order, frame, centroids);
    case PlainBuild::kAvx2:
      return walk_avx2(order, frame, centroids);
    default:
      return walk_portable(order, frame, centroids);
  }
}

template <typename Pixel>
std::uint64_t sum_pixels(PlainBuild build, const Pixel* pixels, std::int64_t n) noexcept {
  switch (build) {
    case PlainBuild::kAvx512:
      return sum_avx512(pixels, n);
    case PlainBuild::kAvx2:
      return sum_avx2(pixels, n);
    default:
      return sum_portable(pixels, n);
  }
}

template void find_plain_centroids(PlainBuild, PlainOrder, const PlainFrame<std::uint8_t>&,
                                   const PlainCentroids&) noexcept;
template void find_plain_centroids(PlainBuild, PlainOrder, const PlainFrame<std::uint16_t>&,
                                   const PlainCentroids&) noexcept;
template std::uint64_t sum_pixels(PlainBuild, const std::uint8_t*, std::int64_t) noexcept;
template std::uint64_t sum_pixels(PlainBuild, const std::uint16_t*, std::int64_t) noexcept;

}  // namespace curlew
