// This file declares how the maps of a frame's pixels are read that the user gives to calibration:
// darks, flats and bad pixels.
#pragma once

#include <algorithm>
#include <string>

#include "acquisition/recording/frame_selection.h"
#include "acquisition/recording/mean_image.h"
#include "core/image.h"

namespace curlew {

/// Returns the same values in another type.
template <typename To, typename From>
Image<To> converted(const Image<From>& from) {
  Image<To> to(from.rows(), from.cols());
  std::transform(from.begin(), from.end(), to.begin(), [](From v) { return static_cast<To>(v); });
  return to;
}

/// Returns the mean of a dark, flat or bad-pixel file. It must have the reference's size, or be as
/// large as the image of which the reference is a region; then the same region is taken. Throws
/// Failure where it does not fit.
MeanImage read_map(const std::string& path, const MeanImage& reference, FrameSelection selection);

/// Returns level and noise of a dark, as "a dark of 100 ADU with 2 ADU of noise over 50 frames".
/// Throws Failure where it is lit.
std::string check_dark(const std::string& path, const MeanImage& dark);

/// Finds the bad pixels of a dark stack, and of a flat where the path is not empty, prints how many
/// there are, and writes them for --bad-pixels. Throws Failure where the dark is lit, where the
/// files do not fit, and where more than a twentieth of the pixels seem bad.
void make_bad_pixels(const std::string& dark_path, const FrameSelection& dark_selection,
                     const std::string& flat_path, const FrameSelection& flat_selection,
                     const std::string& out);

}  // namespace curlew
