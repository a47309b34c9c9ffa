// ModeResults puts Zernike coefficients, and the wavefront in figures, into a results file.
#pragma once

#include <string>

#include "acquisition/fits/fits_file.h"
#include "service/results/row_table.h"
#include "service/results/wavefront_meter.h"
#include "service/stages.h"

namespace curlew {

class ModeResults {
 public:
  /// beside: the file beside which rows wait, see RowTable.
  ModeResults(const Plan& plan, const std::string& beside);

  void add(const FrameSlot& slot);
  /// Appends the images ZERNIKE and ZERNIKE_ERR and the tables ZERNIKE_MODES and WAVEFRONT to the
  /// file.
  void write(FitsFile& file) const;

 private:
  WavefrontMeter meter_;
  double wavelength_m_;
  RowTable coefficients_;  ///< [frames, modes]
  RowTable errors_;        ///< [frames, modes]
  RowTable wavefront_;
};

}  // namespace curlew
