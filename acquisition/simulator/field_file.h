// This reads complex fields from anybody's FITS files, and writes ours.
#pragma once

#include <string>

#include "acquisition/simulator/field.h"

namespace curlew {

/// Reads a complex field from the first image of `path` that has pixels. It is [2, ny, nx] (NAXIS1
/// = nx), real part first, then imaginary, of any FITS number type. nx must be cols·n and ny rows·n
/// for one whole n from 2 to kMaxFieldSamples, the samples per lenslet. Point (0, 0) lies half a
/// sample inside the corner of lenslet (0, 0), and nothing is interpolated or scaled. Throws
/// Failure, which names the file and both sizes, for an image of another shape, and Failure for
/// values that are not finite.
SampledField read_sampled_field(const std::string& path, int rows, int cols);

/// Writes a field as read_sampled_field reads it, in floats. `field` must have no margin.
void write_sampled_field(const std::string& path, const SampledField& field);

}  // namespace curlew
