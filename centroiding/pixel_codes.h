// The gains and offsets of all pixels in one or two bytes each, so that a frame is measured at the
// pace at which the memory delivers it.
#pragma once

#include <cstdint>

#include "core/image.h"

namespace curlew {

/// Codes of the type Code. A pixel's gain is gain_base + gain_step·code, and a gain code of 0 says
/// that the pixel is bad. Its offset is offset_base + offset_step·code. Both steps are powers of
/// two, so that simple values are coded exactly.
template <typename Code>
struct PixelCodes {
  Image<Code> gain;  ///< [frame_rows, frame_cols], as `offset`; both are empty where not used
  Image<Code> offset;
  float gain_base = 0;
  float gain_step = 0;
  float offset_base = 0;
  float offset_step = 0;

  bool empty() const { return gain.empty(); }
};

/// How far a pixel's code may be from its value.
struct CodeTolerance {
  double gain = 0;    ///< rms
  double offset = 0;  ///< rms, counts
};

/// Codes the maps, which are [frame_rows, frame_cols] and not empty, and puts what the codes stand
/// for into the maps themselves. Returns false, and leaves the maps alone, if the codes are too
/// coarse for the tolerance. A gain of 0 says that the pixel is bad.
template <typename Code>
bool code_maps(Image<float>& gain, Image<float>& offset, CodeTolerance tolerance,
               PixelCodes<Code>& codes);

}  // namespace curlew
