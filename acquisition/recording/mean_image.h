// This takes the mean of a dark, flat or reference stack.
#pragma once

#include <cstdint>
#include <string>

#include "core/frame.h"
#include "core/image.h"

namespace curlew {

/// Holds mean and scatter of an image or a stack of images, [rows, cols], in physical ADU.
struct MeanImage {
  Image<double> mean;      ///< NaN where any frame is NaN, infinite or undefined
  Image<double> variance;  ///< over frames, n−1 in the denominator; empty for a single frame
  std::int64_t frames = 0;
  FrameFormat region{};  ///< rows, cols, offset and binning; the rest has no meaning
};

/// Reads the first image of any FITS file that FitsSource takes, without mapping it. Throws Failure
/// as FitsCube::open does, and if no pixel is finite in all frames.
MeanImage read_mean_image(const std::string& path);

}  // namespace curlew
