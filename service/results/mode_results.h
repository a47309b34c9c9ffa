// ModeResults puts Zernike coefficients, and the wavefront in figures, into a results file.
#pragma once

#include <vector>

#include "acquisition/fits/fits_file.h"
#include "reconstruct/modes/mode_fit.h"
#include "service/results/memory_table.h"
#include "service/results/wavefront_figures.h"
#include "service/stages.h"

namespace curlew {

/// Returns the modes for the plan's lit lenslets: seven radial orders, or as many as they allow.
ModePlan modes_of(const Plan& plan);

class ModeResults {
 public:
  explicit ModeResults(const Plan& plan);

  void add(const FrameSlot& slot);
  /// Appends the images ZERNIKE and ZERNIKE_ERR and the tables ZERNIKE_MODES and WAVEFRONT to the
  /// file.
  void write(FitsFile& file) const;

 private:
  ModePlan plan_;
  ModeFit fit_;
  double wavelength_m_;
  std::vector<float> coefficients_;  ///< [frames, modes]
  std::vector<float> errors_;        ///< [frames, modes]
  MemoryTable wavefront_;
};

}  // namespace curlew
