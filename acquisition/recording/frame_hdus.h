// This finds the HDUs of a FITS file that hold its frames.
#pragma once

#include <string>
#include <vector>

#include "acquisition/fits/fits_file.h"
#include "acquisition/recording/frame_selection.h"

namespace curlew {

/// Names the images that are the frames of a file, in their order. There are several only if all
/// have the same size and type.
struct FrameHdus {
  std::vector<int> hdus{};
  ImageInfo image{};   ///< describes each of them
  std::string note{};  ///< a sentence on what was chosen; empty if there was no choice
};

/// Chooses among the images that have pixels. What selection.hdu names is taken as it is. Without
/// it, those images are taken whose names say selection.content (SCI, DARK and the like); if there
/// are none, images whose names say another content are left out. Of what remains, the only image
/// is taken, or the only cube, or all images if each is a single frame of the same size and type.
/// Throws Failure, which lists the HDUs, if none of these leaves one answer, and whatever
/// FitsFile::image throws. An image UNFINISHED of a recording never counts.
FrameHdus find_frame_hdus(FitsFile& file, const FrameSelection& selection);

}  // namespace curlew
