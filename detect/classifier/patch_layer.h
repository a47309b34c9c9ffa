// This file declares a layer on the codes of a square of lenslets in fixed point, which is twice as
// fast as float.
#pragma once

#include <cstddef>
#include <cstdint>

#include "core/image.h"

namespace curlew {

struct DenseLayer;

/// Codes are kept in units of 1/kCodeSteps, up to kMaxCode. Trained spots reach 2.7.
inline constexpr float kCodeSteps = 1024.0F;
inline constexpr std::int16_t kMaxCode = 8191;

/// Sets to[i] to from[i] in fixed point. No from[i] may be negative.
void round_codes(const float* from, int n, std::int16_t* to) noexcept;

/// Sets to[i] = exp(from[i]), to 4 units in the last place, where from[i] is first clamped to ±20.
void take_exponentials(const float* from, int n, float* to) noexcept;

/// Holds a layer's weights in fixed point, as fine as sums of kMaxCode in 32 bits allow.
struct PatchLayer {
  /// Takes a layer whose inputs are `rows` rows of codes. The number of inputs in a row must be
  /// even, and that of outputs a multiple of kProductColumns.
  PatchLayer(const DenseLayer& layer, int rows);

  int rows;
  int row_codes;  ///< codes in a row
  int outputs;
  AlignedVector<std::int16_t> weights;  ///< [pairs of codes, outputs, 2]
  AlignedVector<float> scale;           ///< [outputs] factors of the sums
  AlignedVector<float> bias;
};

/// Computes out[i, output] = max(0, codes·weights + bias) for n patches, where row r of patch i
/// begins at codes[starts[i] + r·row_step]. `out` is [n, outputs] without gaps. All but the last
/// product and sum are exact, so that a patch depends neither on its neighbours nor on the
/// instruction set.
void multiply_patches(const PatchLayer& layer, const std::int16_t* codes, std::ptrdiff_t row_step,
                      const std::int32_t* starts, int n, float* out) noexcept;

}  // namespace curlew
