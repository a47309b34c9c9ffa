// These are the header keys that recordings and sensor files share.
#pragma once

#include "acquisition/fits/fits_file.h"
#include "core/frame.h"
#include "core/optics.h"

namespace curlew {

/// Overwrites those values for which the selected HDU's header has a key, of PITCH_M FOCAL_M
/// PIXEL_M WAVELEN MAGNIF PARITY (1, or −1 for a mirrored relay), and leaves the rest as it is.
/// Throws Failure for a value that makes no sense.
void read_optics(FitsFile& file, Optics& optics);

/// As read_optics, for the keys EPERADU RDNOISE SATURATE BITDEPTH.
void read_detector(FitsFile& file, Detector& detector);

/// As read_optics, for the keys OFFSETX OFFSETY (first column and row on the full detector, px)
/// XBINNING YBINNING. Throws Failure also if the two binnings differ, because pixels are square.
void read_region(FitsFile& file, FrameFormat& format);

/// These write what is known (neither NaN nor 0 bits) into the selected HDU's header.
void write_optics(FitsFile& file, const Optics& optics);
void write_detector(FitsFile& file, const Detector& detector);
void write_region(FitsFile& file, const FrameFormat& format);

}  // namespace curlew
