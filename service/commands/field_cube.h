// The true fields of simulated frames, as one file.
#pragma once

#include <cstdint>
#include <string>

#include "acquisition/fits/fits_file.h"
#include "acquisition/simulator/field.h"

namespace curlew {

/// Writes the fields of many frames as one cube of floats, [frames, 2, ny, nx], real parts first.
/// The file appears under its name by commit(), which must follow `frames` fields.
class FieldCubeWriter {
 public:
  FieldCubeWriter(const std::string& path, std::int64_t frames);

  /// `field` must have no margin, and the size of those before.
  void append(const SampledField& field);
  void commit() { file_.commit(); }

 private:
  FitsFile file_;
  std::int64_t frames_;
  std::int64_t written_ = 0;  ///< numbers
};

}  // namespace curlew
