// This takes the mean of a dark, flat or reference stack.
#pragma once

#include <cstdint>
#include <string>

#include "acquisition/recording/frame_selection.h"
#include "core/frame.h"
#include "core/image.h"

namespace curlew {

/// Holds mean and scatter of an image or a stack of images, [rows, cols], in physical ADU.
struct MeanImage {
  Image<double> mean;      ///< NaN where a frame is not finite, or all are far outliers
  Image<double> variance;  ///< over frames, n−1 in the denominator; empty for a single frame
  std::int64_t frames = 0;
  FrameFormat region{};  ///< rows, cols, offset and binning; the rest has no meaning
  PixelRegion part{};    ///< the part of the file's image that was read
  int image_rows = 0;    ///< size of that image
  int image_cols = 0;
};

/// Reads the frames of any FITS file that FitsSource takes, without mapping them. What FitsSource
/// would clip is clipped, see PixelRange. Throws Failure as FitsCube::open does, and if no pixel is
/// finite in all frames.
MeanImage read_mean_image(const std::string& path, const FrameSelection& selection = {});

}  // namespace curlew
