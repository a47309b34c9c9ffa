// The header keys that recordings and sensor files share.
#pragma once

#include "acquisition/fits/fits_file.h"
#include "core/frame.h"
#include "core/optics.h"

namespace curlew {

/// Overwrites what the selected HDU's header says, of PITCH_M FOCAL_M PIXEL_M WAVELEN MAGNIF
/// PARITY (1, or −1 for a mirrored relay), and leaves the rest as it is.
void read_optics(FitsFile& file, Optics& optics);

/// As read_optics: EPERADU RDNOISE SATURATE BITDEPTH.
void read_detector(FitsFile& file, Detector& detector);

/// As read_optics: OFFSETX OFFSETY (first column and row on the full detector, px), XBINNING,
/// YBINNING. Failure where the two binnings differ: pixels are square.
void read_region(FitsFile& file, FrameFormat& format);

/// Writes what is known (neither NaN nor 0 bits) into the selected HDU's header.
void write_optics(FitsFile& file, const Optics& optics);
void write_detector(FitsFile& file, const Detector& detector);
void write_region(FitsFile& file, const FrameFormat& format);

}  // namespace curlew
