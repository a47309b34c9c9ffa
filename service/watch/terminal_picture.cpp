#include "service/watch/terminal_picture.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "acquisition/pictures/png_file.h"
#include "service/picture/canvas.h"

namespace curlew {
namespace {

using Picture = Image<Rgb>;

constexpr Rgb kBlack{0, 0, 0};
constexpr Rgb kWhite{255, 255, 255};

Rgb between(Rgb a, Rgb b, float fraction) {
  const auto mix = [fraction](std::uint8_t from, std::uint8_t to) {
    return static_cast<std::uint8_t>(std::lround(
        static_cast<float>(from) + fraction * (static_cast<float>(to) - static_cast<float>(from))));
  };
  return {mix(a.red, b.red), mix(a.green, b.green), mix(a.blue, b.blue)};
}

/// Blue below 0, brown above; value from −1 to 1.
Rgb signed_colour(float value) {
  constexpr Rgb kMiddle{241, 239, 236};
  constexpr Rgb kLow{31, 92, 153};
  constexpr Rgb kHigh{151, 85, 31};
  const float size = std::min(1.0F, std::abs(value));
  return between(kMiddle, value < 0.0F ? kLow : kHigh, size);
}

template <typename Pixel>
Picture spots_of(const FrameCopy& copy, int cols) {
  const auto* pixels = reinterpret_cast<const Pixel*>(copy.pixels.data());
  const int by = (copy.format.cols + cols - 1) / cols;
  // Every character shows the brightest of its pixels, so that no spot falls between them.
  Image<float> brightest((copy.format.rows + by - 1) / by, (copy.format.cols + by - 1) / by);
  for (int row = 0; row < copy.format.rows; ++row)
    for (int col = 0; col < copy.format.cols; ++col) {
      const auto at = static_cast<std::size_t>(row) * static_cast<std::size_t>(copy.format.cols) +
                      static_cast<std::size_t>(col);
      float& cell = brightest(row / by, col / by);
      cell = std::max(cell, static_cast<float>(pixels[at]));
    }
  const auto [low, high] = std::minmax_element(brightest.begin(), brightest.end());
  Picture picture(brightest.rows(), brightest.cols());
  for (std::size_t i = 0; i < picture.size(); ++i)
    picture[i] =
        between(kBlack, kWhite, std::sqrt((brightest[i] - *low) / std::max(1.0F, *high - *low)));
  return picture;
}

/// Returns a map of signed values in colours, and its scale: the largest value.
template <typename Counts>
Picture signed_map(const Image<float>& map, float& scale, Counts&& counts) {
  scale = 0.0F;
  for (std::size_t i = 0; i < map.size(); ++i)
    if (counts(i)) scale = std::max(scale, std::abs(map[i]));
  Picture picture(map.rows(), map.cols(), kBlack);
  for (std::size_t i = 0; i < map.size(); ++i)
    if (counts(i)) picture[i] = signed_colour(scale > 0.0F ? map[i] / scale : 0.0F);
  return picture;
}

void mark_vortices(const VortexList& vortices, Picture& cells) {
  for (const Vortex& vortex : vortices) {
    const int row = static_cast<int>(std::lround(vortex.y - 0.5F));
    const int col = static_cast<int>(std::lround(vortex.x - 0.5F));
    if (cells.contains(row, col))
      cells(row, col) = vortex.charge > 0 ? kRed : (vortex.charge < 0 ? kBlue : kWhite);
  }
}

/// Returns the picture with every nth row and column, so that it is at most cols wide.
Picture narrowed(const Picture& picture, int cols) {
  const int by = (picture.cols() + cols - 1) / cols;
  if (by == 1) return picture;
  Picture small((picture.rows() + by - 1) / by, (picture.cols() + by - 1) / by);
  for (int row = 0; row < small.rows(); ++row)
    for (int col = 0; col < small.cols(); ++col) small(row, col) = picture(row * by, col * by);
  return small;
}

void append_line(const Picture& picture, int line, std::string& text) {
  const auto at = [&](int row, int col) {
    return picture.contains(row, col) ? picture(row, col) : kBlack;
  };
  for (int col = 0; col < picture.cols(); ++col) {
    const Rgb upper = at(2 * line, col);
    const Rgb lower = at(2 * line + 1, col);
    text += fmt::format("\x1b[38;2;{};{};{};48;2;{};{};{}m▀", upper.red, upper.green, upper.blue,
                        lower.red, lower.green, lower.blue);
  }
  text += "\x1b[0m  ";
}

}  // namespace

std::string terminal_picture(const FrameCopy& copy, int cols) {
  float phase_scale = 0.0F;
  float circulation_scale = 0.0F;
  const Picture spots = copy.format.pixel_type == PixelType::kU8
                            ? spots_of<std::uint8_t>(copy, cols)
                            : spots_of<std::uint16_t>(copy, cols);
  const Picture phase = signed_map(copy.map(PageMap::kPhase), phase_scale,
                                   [&](std::size_t i) { return copy.slopes.valid[i] != 0; });
  Picture cells = signed_map(copy.map(PageMap::kCirculation), circulation_scale,
                             [&](std::size_t i) { return copy.circulation_valid[i] != 0; });
  mark_vortices(copy.result.vortices, cells);
  const std::array<Picture, 3> panes{spots, narrowed(phase, cols), narrowed(cells, cols)};
  int rows = 0;
  for (const Picture& pane : panes) rows = std::max(rows, pane.rows());
  std::string text;
  for (int line = 0; 2 * line < rows; ++line) {
    for (const Picture& pane : panes) append_line(pane, line, text);
    text += "\x1b[K\n";
  }
  return text + fmt::format("frame {}  phase ±{:.2f} rad  circulation ±{:.2f} rad\x1b[K\n",
                            copy.result.frame_index, phase_scale, circulation_scale);
}

}  // namespace curlew
