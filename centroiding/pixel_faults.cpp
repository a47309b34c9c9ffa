#include "centroiding/pixel_faults.h"

#include <array>
#include <cstdint>

namespace curlew {
namespace {

constexpr int kOfWindow = 3;      // A line begins in this part of its window, and ends in the last
constexpr float kOfLine = 0.25F;  // part of a line that no spot outshines

float second_brightest(float left, float right, float above, float below) noexcept {
  const float high = std::max(left, right), low = std::min(left, right);
  const float high2 = std::max(above, below), low2 = std::min(above, below);
  return std::max(std::min(high, high2), std::max(low, low2));
}

float count_at(FrameView frame, int x, int y) noexcept {
  const std::size_t i = as_size(y) * as_size(frame.cols) + as_size(x);
  return frame.pixel_type == PixelType::kU16 ? static_cast<float>(frame.data<std::uint16_t>()[i])
                                             : static_cast<float>(frame.data<std::uint8_t>()[i]);
}

/// Returns whether what `exceeds(i)` says of the pixels [0, end) of a line's `n` in the window
/// makes it a line. The pixel end − 1 is one that exceeds its neighbours.
template <typename Exceeds>
bool is_line(int end, int n, const Exceeds& exceeds) noexcept {
  if (end + n / kOfWindow <= n) return false;
  int passed = 0;
  bool begins = false;
  for (int i = 0; i < end; ++i) {
    if (!exceeds(i)) continue;
    ++passed;
    begins = begins || i < std::max(n / kOfWindow, 1);
  }
  return begins && static_cast<float>(passed) >= kOfLine * static_cast<float>(n);
}

}  // namespace

/// Returns the pixel's light above the lenslet's level, in counts; 0 for a bad pixel.
float PixelFaults::light(int x, int y) const noexcept {
  const float count = count_at(frame_, x, y);
  if (plan_.gain.empty()) return count - (plan_.uniform_offset - plan_.threshold + level_);
  const float gain = plan_.gain(y, x);
  return gain > 0.0F ? gain * count - (plan_.offset(y, x) - plan_.threshold + level_) : 0.0F;
}

bool PixelFaults::exceeds(float here, float neighbour, float times, float sigmas) const noexcept {
  if (!(here > 0.0F)) return false;
  const float variance = levels_.pixel_variance + here * plan_.counts_per_e;
  return here > times * std::max(neighbour, 0.0F) + sigmas * std::sqrt(variance);
}

bool PixelFaults::is_sharp(float here, float neighbour) const noexcept {
  return sharpness_ > 0.0F && exceeds(here, neighbour, sharpness_, kSharpSigmas);
}

bool PixelFaults::is_line_sharp(float here, float neighbour) const noexcept {
  constexpr float kSharper = 1.75F;  // Side lobes are half as wide as spots.
  return sharpness_ > 0.0F && exceeds(here, neighbour, kSharper * sharpness_, kSharpSigmas);
}

/// Returns whether a pixel of the window has so much more light that this much hardly counts.
bool PixelFaults::is_outshone(float here) const noexcept {
  constexpr float kMuchMore = 40.0F;
  for (int i = 0; i < window_.h; ++i) {
    const int row = window_.y0 + (window_.h / 2 + i) % window_.h;  // from the middle on
    for (int x = window_.x0; x < window_.x0 + window_.w; ++x)
      if (light(x, row) > kMuchMore * here) return true;
  }
  return false;
}

bool PixelFaults::is_dead(float here) const noexcept {
  return here < -dead_depth(levels_) - std::max(level_, 0.0F);
}

bool PixelFaults::is_in_clump(int x, int y) const noexcept {
  const auto second = [&](int d) {
    return second_brightest(light(x - d, y), light(x + d, y), light(x, y - d), light(x, y + d));
  };
  const float here = light(x, y);
  return exceeds(here, second(2), clump_sharpness_, kClumpSigmas) && !is_sharp(here, second(1)) &&
         !is_outshone(here);
}

PixelFault PixelFaults::at(int x, int y) const noexcept {
  const float here = light(x, y);
  if (is_dead(here)) return dead(x, y);
  const float left = light(x - 1, y), right = light(x + 1, y);
  const float above = light(x, y - 1), below = light(x, y + 1);
  if (is_sharp(here, second_brightest(left, right, above, below))) return PixelFault::kSingle;
  const bool in_line = (is_line_sharp(here, std::max(left, right)) && is_in_bright_column(x, y)) ||
                       (is_line_sharp(here, std::max(above, below)) && is_in_bright_row(x, y));
  return in_line && !is_outshone(here) ? PixelFault::kWide : PixelFault::kNone;
}

PixelFault PixelFaults::dead(int x, int y) const noexcept {
  const std::array neighbours{light(x - 1, y), light(x + 1, y), light(x, y - 1), light(x, y + 1)};
  int dead = 0;
  bool lit = false;
  for (const float neighbour : neighbours) {
    dead += is_dead(neighbour) ? 1 : 0;
    lit = lit || neighbour > levels_.threshold;
  }
  if (!lit) return PixelFault::kNone;
  return dead <= 1 ? PixelFault::kSingle : PixelFault::kWide;
}

bool PixelFaults::is_in_bright_column(int x, int y) const noexcept {
  return is_line(y - window_.y0 + 1, window_.h, [&](int i) {
    const int row = window_.y0 + i;
    return is_line_sharp(light(x, row), std::max(light(x - 1, row), light(x + 1, row)));
  });
}

bool PixelFaults::is_in_bright_row(int x, int y) const noexcept {
  return is_line(x - window_.x0 + 1, window_.w, [&](int i) {
    const int column = window_.x0 + i;
    return is_line_sharp(light(column, y), std::max(light(column, y - 1), light(column, y + 1)));
  });
}

}  // namespace curlew
