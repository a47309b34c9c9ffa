// A Canvas is a frame in grey, enlarged, on which windows, spots and arrows are drawn.
#pragma once

#include <string>

#include "acquisition/pictures/png_file.h"
#include "core/image.h"

namespace curlew {

/// Colours that stay apart on grey.
inline constexpr Rgb kGreen{60, 200, 90};
inline constexpr Rgb kYellow{250, 220, 60};
inline constexpr Rgb kOrange{255, 140, 0};
inline constexpr Rgb kRed{240, 50, 50};
inline constexpr Rgb kBlue{80, 150, 255};
inline constexpr Rgb kMagenta{230, 80, 230};
inline constexpr Rgb kSlate{90, 100, 120};

/// All places are in pixels of the frame: the centre of pixel (0, 0) is (0, 0). What lies outside
/// is not drawn.
class Canvas {
 public:
  /// frame: [rows, cols], not empty; pixels that are not finite are black. Grey goes with the
  /// square root of the light between the 5th and the 99.8th percentile. A pixel becomes a square
  /// of so many pixels that `pitch_px` has 24 at least, as far as no side becomes longer than 8192.
  Canvas(const Image<float>& frame, double pitch_px);

  void draw_line(double x0, double y0, double x1, double y1, Rgb colour);
  /// Draws the outline of columns [x0, x0+w) and rows [y0, y0+h).
  void draw_window(double x0, double y0, double w, double h, Rgb colour);
  void draw_cross(double x, double y, double arm_px, Rgb colour);
  void draw_circle(double x, double y, double radius_px, Rgb colour);
  /// Draws a line with a head at its end (x1, y1).
  void draw_arrow(double x0, double y0, double x1, double y1, Rgb colour);
  /// Colours one pixel of the frame.
  void fill_pixel(int x, int y, Rgb colour);

  const Image<Rgb>& picture() const { return picture_; }
  int scale() const { return scale_; }
  /// Writes a PNG. Throws Failure, which names the file.
  void write(const std::string& path) const { write_png(path, picture_); }

 private:
  void dot(double x, double y, Rgb colour);

  int scale_ = 1;
  Image<Rgb> picture_;
};

}  // namespace curlew
