#include "centroiding/pixel_codes.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

namespace curlew {
namespace {

/// These are equidistant values, of which the first has code 0.
struct Scale {
  double first = 0.0;
  double step = 0.0;
  double rms_error() const { return step / std::sqrt(12.0); }
};

/// Returns the finest scale that spans [low, high] with `steps` steps.
Scale scale_of(float low, float high, int steps) {
  const double range = static_cast<double>(high) - static_cast<double>(low);
  return {.first = static_cast<double>(low),
          .step = range > 0.0 ? std::exp2(std::ceil(std::log2(range / steps))) : 0.0};
}

/// Returns the code of `value`, of which 0 stands for scale.first.
int code_of(const Scale& scale, float value) {
  if (!(scale.step > 0.0)) return 0;
  return static_cast<int>(std::lround((static_cast<double>(value) - scale.first) / scale.step));
}

}  // namespace

template <typename Code>
bool code_maps(Image<float>& gain, Image<float>& offset, CodeTolerance tolerance,
               PixelCodes<Code>& codes) {
  constexpr int kMaxCode = std::numeric_limits<Code>::max();
  float low_gain = 1.0F, high_gain = 1.0F, low = 0.0F, high = 0.0F;
  bool any = false;
  for (std::size_t i = 0; i < gain.size(); ++i) {
    if (!(gain[i] > 0.0F)) continue;
    low_gain = any ? std::min(low_gain, gain[i]) : gain[i];
    high_gain = any ? std::max(high_gain, gain[i]) : gain[i];
    low = any ? std::min(low, offset[i]) : offset[i];
    high = any ? std::max(high, offset[i]) : offset[i];
    any = true;
  }
  const Scale gains = scale_of(low_gain, high_gain, kMaxCode - 1);
  const Scale offsets = scale_of(low, high, kMaxCode);
  if (gains.rms_error() > tolerance.gain || offsets.rms_error() > tolerance.offset) return false;

  codes.gain = Image<Code>(gain.rows(), gain.cols());
  codes.offset = Image<Code>(gain.rows(), gain.cols());
  codes.gain_step = static_cast<float>(gains.step);
  codes.gain_base = low_gain - codes.gain_step;  // Code 0 is that of bad pixels.
  codes.offset_step = static_cast<float>(offsets.step);
  codes.offset_base = low;
  for (std::size_t i = 0; i < gain.size(); ++i) {
    if (!(gain[i] > 0.0F)) continue;
    codes.gain[i] = static_cast<Code>(1 + code_of(gains, gain[i]));
    codes.offset[i] = static_cast<Code>(code_of(offsets, offset[i]));
    gain[i] = codes.gain_base + codes.gain_step * static_cast<float>(codes.gain[i]);
    offset[i] = codes.offset_base + codes.offset_step * static_cast<float>(codes.offset[i]);
  }
  return true;
}

template bool code_maps(Image<float>&, Image<float>&, CodeTolerance, PixelCodes<std::uint8_t>&);
template bool code_maps(Image<float>&, Image<float>&, CodeTolerance, PixelCodes<std::uint16_t>&);

}  // namespace curlew
