#pragma once

#include "acquisition/simulator/field.h"

namespace curlew {

/// Returns the parameters of a square field of so many lenslets a side.
inline FieldParameters small_field(double rytov_variance, int lenslets) {
  FieldParameters parameters;
  parameters.rytov_variance = rytov_variance;
  parameters.rows = parameters.cols = lenslets;
  return parameters;
}

}  // namespace curlew
