// A layer on the codes of a square of lenslets, in fixed point: twice as fast as in float.
#pragma once

#include <cstddef>
#include <cstdint>

#include "core/image.h"

namespace curlew {

struct DenseLayer;

/// Codes are kept in units of 1/kCodeSteps, up to kMaxCode: trained spots reach 2.7.
inline constexpr float kCodeSteps = 1024.0F;
inline constexpr std::int16_t kMaxCode = 8191;

/// to[i] = from[i] in fixed point; from is not negative.
void round_codes(const float* from, int n, std::int16_t* to) noexcept;

/// to[i] = exp(from[i]), from within ±20 or as if, to 4 units in the last place.
void take_exponentials(const float* from, int n, float* to) noexcept;

/// A layer's weights in fixed point, as fine as sums of kMaxCode in 32 bits allow.
struct PatchLayer {
  /// layer: its inputs are `rows` rows of codes. Inputs of a row are even, outputs a multiple of
  /// kProductColumns.
  PatchLayer(const DenseLayer& layer, int rows);

  int rows;
  int row_codes;  ///< of a row
  int outputs;
  AlignedVector<std::int16_t> weights;  ///< [pairs of codes, outputs, 2]
  AlignedVector<float> scale;           ///< [outputs], of a sum
  AlignedVector<float> bias;
};

/// out[i, output] = max(0, codes·weights + bias) for n patches: row r of patch i begins at
/// codes[starts[i] + r·row_step]. out: [n, outputs] without gaps. All but the last product and sum
/// are exact, so that a patch does not depend on its neighbours, nor on the instruction set.
void multiply_patches(const PatchLayer& layer, const std::int16_t* codes, std::ptrdiff_t row_step,
                      const std::int32_t* starts, int n, float* out) noexcept;

}  // namespace curlew
