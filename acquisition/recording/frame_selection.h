// A FrameSelection says which image of a FITS file, and which part of it, holds the frames.
#pragma once

#include <optional>
#include <string>

namespace curlew {

/// Holds columns [x, x + width) and rows [y, y + height) of an image, in px from 0.
struct PixelRegion {
  int x = 0;
  int y = 0;
  int width = 0;
  int height = 0;
  bool operator==(const PixelRegion&) const = default;
};

/// Says what an image is read as. Where a file holds several images, their names tell which is
/// meant.
enum class ImageContent { kFrames, kDark, kFlat, kBadPixels };

/// Says what the user wants to be read of a file.
struct FrameSelection {
  std::string hdu{};                    ///< an EXTNAME, or a number (0: the primary); empty: choose
  std::optional<PixelRegion> region{};  ///< without one, DATASEC where a header has it, else all
  ImageContent content = ImageContent::kFrames;
};

/// Reads "X,Y,W,H", whose numbers are px from 0. Throws UsageError for anything else. An empty text
/// gives no region.
std::optional<PixelRegion> parse_region(const std::string& text);

/// Reads a section "[x1:x2,y1:y2]" as FITS headers have it: px from 1, both ends included. Returns
/// nullopt if it is none, or an empty one.
std::optional<PixelRegion> parse_section(const std::string& text);

/// Returns "columns 20 to 275 and rows 0 to 255".
std::string region_text(const PixelRegion& region);

}  // namespace curlew
