// Complex fields in FITS: anybody's to read, ours to write.
#pragma once

#include <string>

#include "acquisition/simulator/field.h"

namespace curlew {

/// Reads a complex field: the first image of `path` that has one, [2, ny, nx] (NAXIS1 = nx),
/// real part first, then imaginary, of any FITS number type. nx must be cols·n and ny rows·n for
/// one whole n ≥ 2, the samples a lenslet; point (0, 0) lies half a sample inside the corner of
/// lenslet (0, 0), and nothing is interpolated or scaled. Throws Failure naming the file and both
/// sizes.
SampledField read_sampled_field(const std::string& path, int rows, int cols);

/// Writes a field as read_sampled_field reads it, in floats. `field` must have no margin.
void write_sampled_field(const std::string& path, const SampledField& field);

}  // namespace curlew
