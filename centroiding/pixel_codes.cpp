#include "centroiding/pixel_codes.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace curlew {
namespace {

/// What good pixels' gains and offsets lie between.
struct MapRange {
  float low_gain = 1;
  float high_gain = 1;
  float low_offset = 0;
  float high_offset = 0;
};

MapRange range_of(const Image<float>& gain, const Image<float>& offset) {
  MapRange range;
  bool any = false;
  for (std::size_t i = 0; i < gain.size(); ++i) {
    if (!(gain[i] > 0.0F)) continue;
    if (!any) range = {gain[i], gain[i], offset[i], offset[i]};
    any = true;
    range.low_gain = std::min(range.low_gain, gain[i]);
    range.high_gain = std::max(range.high_gain, gain[i]);
    range.low_offset = std::min(range.low_offset, offset[i]);
    range.high_offset = std::max(range.high_offset, offset[i]);
  }
  return range;
}

double rms_of_rounding(double step) { return step / std::sqrt(12.0); }

/// Returns the smallest power of two that spans the range in so many steps, or 0 if it is empty.
double step_of(float low, float high, int steps) {
  const double range = static_cast<double>(high) - static_cast<double>(low);
  return range > 0.0 ? std::exp2(std::ceil(std::log2(range / steps))) : 0.0;
}

int code_of(float value, float first, double step) {
  if (!(step > 0.0)) return 0;
  return static_cast<int>(
      std::lround((static_cast<double>(value) - static_cast<double>(first)) / step));
}

}  // namespace

bool code_in_words(Image<float>& gain, Image<float>& offset, const CodeTolerance& tolerance,
                   PixelWords& words) {
  constexpr double kOne = 65536.0;  // of H
  constexpr int kMaxByte = 254;     // 255 would come near kBadWord.
  const MapRange range = range_of(gain, offset);
  constexpr double kGainStep = 256 >> PixelWords::kGainShift;  // of the upper byte
  const bool even = range.low_gain == range.high_gain;
  // The lower byte stands for a fraction of a step, so that the gain falls by a step at least.
  const double max_gain =
      static_cast<double>(range.high_gain) / (even ? 1.0 : 1.0 - kGainStep / kOne);

  // The coarsest unit that is fine enough: signal, offset and threshold are rounded to it.
  const auto error = [&](int scale) { return std::sqrt(3.0) * rms_of_rounding(max_gain / scale); };
  int scale = 1;
  while (error(scale) > tolerance.offset && scale < 32768) scale *= 2;
  const double unit = max_gain / scale;
  const double offsets = static_cast<double>(range.high_offset - range.low_offset) / unit;
  if (error(scale) > tolerance.offset || 0.25 * tolerance.brightest * scale > kOne - 1.0 ||
      offsets > kMaxByte - 1)
    return false;

  const double falls = kOne * (max_gain - static_cast<double>(range.low_gain)) / max_gain;
  if (falls > kGainStep * kMaxByte ||
      (!even && max_gain * rms_of_rounding(kGainStep) / kOne > tolerance.gain))
    return false;

  words.words = Image<std::uint16_t>(gain.rows(), gain.cols(), PixelWords::kBadWord);
  words.gain_mask = even ? 0 : 0xFFFF;
  words.count_scale = scale;
  words.unit = static_cast<float>(unit);
  words.offset_base = range.low_offset;
  for (std::size_t i = 0; i < gain.size(); ++i) {
    if (!(gain[i] > 0.0F)) continue;
    const double fall = kOne * (max_gain - static_cast<double>(gain[i])) / max_gain;
    const double above =
        (static_cast<double>(offset[i]) - static_cast<double>(range.low_offset)) / unit;
    const double lost = even ? 0.0 : 0.5;  // to ⌊⌋
    const int low = static_cast<int>(std::lround(above + lost));
    const int high = even ? 0 : static_cast<int>(std::lround(fall / kGainStep - low / 256.0));
    const int word = 256 * high + low;
    const int h = (word >> PixelWords::kGainShift) & words.gain_mask;
    words.words[i] = static_cast<std::uint16_t>(word);
    gain[i] = static_cast<float>(max_gain * (1.0 - h / kOne));
    offset[i] = range.low_offset + words.unit * static_cast<float>(low - lost);
  }
  return true;
}

bool code_maps(Image<float>& gain, Image<float>& offset, const CodeTolerance& tolerance,
               PixelCodes& codes) {
  constexpr int kMaxCode = 65535;
  const MapRange range = range_of(gain, offset);
  const double gain_step = step_of(range.low_gain, range.high_gain, kMaxCode - 1);
  const double offset_step = step_of(range.low_offset, range.high_offset, kMaxCode);
  if (rms_of_rounding(gain_step) > tolerance.gain ||
      rms_of_rounding(offset_step) > tolerance.offset)
    return false;

  codes.gain = Image<std::uint16_t>(gain.rows(), gain.cols());
  codes.offset = Image<std::uint16_t>(gain.rows(), gain.cols());
  codes.gain_step = static_cast<float>(gain_step);
  codes.gain_base = range.low_gain - codes.gain_step;  // Code 0 is that of bad pixels.
  codes.offset_step = static_cast<float>(offset_step);
  codes.offset_base = range.low_offset;
  for (std::size_t i = 0; i < gain.size(); ++i) {
    if (!(gain[i] > 0.0F)) continue;
    const int gain_code = 1 + code_of(gain[i], range.low_gain, gain_step);
    codes.gain[i] = static_cast<std::uint16_t>(gain_code);
    codes.offset[i] = static_cast<std::uint16_t>(code_of(offset[i], range.low_offset, offset_step));
    gain[i] = codes.gain_base + codes.gain_step * static_cast<float>(codes.gain[i]);
    offset[i] = codes.offset_base + codes.offset_step * static_cast<float>(codes.offset[i]);
  }
  return true;
}

}  // namespace curlew
