// ModeResults puts Zernike coefficients, and the wavefront in figures, into a results file.
#pragma once

#include <string>

#include "acquisition/fits/fits_file.h"
#include "reconstruct/modes/mode_fit.h"
#include "service/results/row_table.h"
#include "service/results/wavefront_figures.h"
#include "service/stages.h"

namespace curlew {

/// The last of Noll's modes in results; with it there are seven radial orders.
inline constexpr int kLastNoll = 36;

/// Returns the modes for the plan's lit lenslets: seven radial orders, or as many as they allow.
ModePlan modes_of(const Plan& plan);

class ModeResults {
 public:
  /// beside: the file beside which rows wait, see RowTable.
  ModeResults(const Plan& plan, const std::string& beside);

  void add(const FrameSlot& slot);
  /// Appends the images ZERNIKE and ZERNIKE_ERR and the tables ZERNIKE_MODES and WAVEFRONT to the
  /// file.
  void write(FitsFile& file) const;

 private:
  ModePlan plan_;
  ModeFit fit_;
  double wavelength_m_;
  RowTable coefficients_;  ///< [frames, modes]
  RowTable errors_;        ///< [frames, modes]
  RowTable wavefront_;
};

}  // namespace curlew
