// Anybody's complex field, read from FITS.
#pragma once

#include <string>

#include "acquisition/field.h"

namespace curlew {

/// Reads a complex field: the first image of `path` that has one, [2, ny, nx] (NAXIS1 = nx),
/// real part first, then imaginary, of any FITS number type. nx must be cols·n and ny rows·n for
/// one whole n ≥ 2, the samples a lenslet; point (0, 0) lies half a sample inside the corner of
/// lenslet (0, 0), and nothing is interpolated or scaled. Throws Failure naming the file and both
/// sizes.
SampledField read_sampled_field(const std::string& path, int rows, int cols);

}  // namespace curlew
