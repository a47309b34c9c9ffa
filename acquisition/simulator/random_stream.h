// A RandomStream gives reproducible random numbers; each (seed, stream number) is independent.
#pragma once

#include <array>
#include <cstdint>

namespace curlew {

/// The generator is xoshiro256++ (D. Blackman and S. Vigna, ACM Trans. Math. Softw. 47, 36, 2021).
/// SplitMix64 fills its state from a seed and a stream number: the same pair gives the same
/// numbers, whoever asks and in whatever order. Nothing here allocates or throws.
class RandomStream {
 public:
  RandomStream(std::uint64_t seed, std::uint64_t stream) noexcept;

  std::uint64_t bits() noexcept;  ///< 64 random bits
  double uniform() noexcept;      ///< in the open interval (0, 1), 53 bits

  /// Returns a standard normal deviate, by the ziggurat of G. Marsaglia and W. W. Tsang, J. Stat.
  /// Softw. 5(8) (2000), 256 layers.
  double gaussian() noexcept;

  /// Returns a Poisson deviate; 0 for a mean that is not positive. It uses inversion below
  /// kInversionMean, and above it the transformed rejection PTRS of W. Hörmann, Insur. Math. Econ.
  /// 12, 39 (1993). Both are exact but for the rounding of double.
  double poisson(double mean) noexcept;

  static constexpr double kInversionMean = 12.0;

 private:
  double poisson_by_rejection(double mean) noexcept;

  std::array<std::uint64_t, 4> state_{};
};

}  // namespace curlew
