// The gains and offsets of all pixels in a few bytes, so that a frame is measured at the pace at
// which the memory delivers it.
#pragma once

#include <cstdint>

#include "core/image.h"

namespace curlew {

/// Gain and offset of each pixel in one word, for arithmetic in whole numbers of 16 bits. `unit` is
/// what the last bit of these stands for, in counts. With H = (word >> kGainShift) & gain_mask and
/// D = the word's lower byte, a pixel has
///     gain = max_gain·(1 − H/65536),  offset = offset_base + unit·D,
///     gain·count/unit = C − ⌊C·H/65536⌋,  C = count·count_scale,  unit = max_gain/count_scale.
/// D is rounded such that half a unit makes up for ⌊⌋. A bad pixel's word is kBadWord.
struct PixelWords {
  static constexpr std::uint16_t kBadWord = 0xFFFF;
  static constexpr int kGainShift = 2;  ///< Gains may differ by a quarter.

  Image<std::uint16_t> words;        ///< [frame_rows, frame_cols]; empty where not used
  std::uint16_t gain_mask = 0xFFFF;  ///< 0 where all gains are alike
  int count_scale = 1;               ///< a power of two
  float unit = 1;
  float offset_base = 0;

  bool empty() const { return words.empty(); }
  /// Brighter counts do not fit into 16 bits.
  float max_count() const {
    const int most = 0xFFFF / count_scale;
    return static_cast<float>(most);
  }
};

/// Gain and offset of each pixel in two bytes each. The gain is gain_base + gain_step·code, and a
/// gain code of 0 says that the pixel is bad. The offset is offset_base + offset_step·code. Both
/// steps are powers of two.
struct PixelCodes {
  Image<std::uint16_t> gain;  ///< [frame_rows, frame_cols], as `offset`; both empty where not used
  Image<std::uint16_t> offset;
  float gain_base = 0;
  float gain_step = 0;
  float offset_base = 0;
  float offset_step = 0;

  bool empty() const { return gain.empty(); }
};

/// How coarse codes may be.
struct CodeTolerance {
  double gain = 0;             ///< rms error of a gain
  double offset = 0;           ///< rms error of a pixel's signal by rounding, counts
  double brightest = 65535.0;  ///< count; a quarter of it must not overflow
};

/// Each of these two codes the maps, which are [frame_rows, frame_cols] and not empty, and puts
/// what the codes stand for into the maps themselves. They return false, and leave the maps alone,
/// if the codes are too coarse for the tolerance. A gain of 0 says that the pixel is bad.
bool code_in_words(Image<float>& gain, Image<float>& offset, const CodeTolerance& tolerance,
                   PixelWords& words);
bool code_maps(Image<float>& gain, Image<float>& offset, const CodeTolerance& tolerance,
               PixelCodes& codes);

}  // namespace curlew
