// This file declares the detector `circulation`. It finds the vortices that stand out of the noise,
// and says where they are and how sure they are.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/image.h"
#include "core/vortex.h"
#include "detect/circulation.h"
#include "detect/false_alarms.h"

namespace curlew {

struct CirculationOptions {
  /// This is the mean number of vortices reported per frame where there is only slope noise. It
  /// must be more than 0.
  double false_alarms_per_frame = 0.01;
  /// Cells with |D| below this are never vortices, however small the noise. It must be more than 0.
  /// A vortex next to its opposite still shows .1 rad when the two are 1/30 pitch apart (D ≈ 3.15·s
  /// for a dipole of separation s). In data without noise, rounding and the smooth phase's fourth
  /// derivative stay below it.
  double min_circulation_rad = 0.1;
  /// A cell is taken for a lobe of another vortex if |D| is below this fraction of the |D| of an
  /// opposite neighbour. It must be in [0, 1). The kernel's own lobes reach .093 of their strongest
  /// neighbour for a round vortex at any position, and .12 for an elongated one at its peak.
  double lobe_fraction = 0.15;
};

/// The plan holds all that follows from the options and the pupil. It is const after construction
/// and shared by threads.
class CirculationPlan {
 public:
  /// `lenslet_valid` is [rows, cols] and nonzero where the sensor has a lenslet. A frame may have
  /// at most `capacity` vortices; VortexList counts those beyond. Throws UsageError where an option
  /// is out of its range, and Failure where there are fewer than 2×2 lenslets.
  CirculationPlan(const CirculationOptions& options, const Image<std::uint8_t>& lenslet_valid,
                  std::size_t capacity);

  const CirculationOptions& options() const { return options_; }
  std::size_t capacity() const { return capacity_; }
  int cell_rows() const { return cell_rows_; }
  int cell_cols() const { return cell_cols_; }
  int n_cells() const { return n_cells_; }  ///< cells whose four lenslets the sensor has

  /// Returns the threshold on |D|/σ_D for a frame with n_valid valid cells; n_valid must be in [0,
  /// cells of the array].
  float threshold_sigmas(int n_valid) const {
    return threshold_[static_cast<std::size_t>(n_valid)];
  }

  /// Returns the flags of a vortex that has cell (row, col) for a neighbour, when that cell is not
  /// valid in a frame. `row` is in [−1, cell_rows] and `col` in [−1, cell_cols], because the
  /// array's surroundings count too.
  std::uint32_t flags_when_missing(int row, int col) const { return missing_(row + 1, col + 1); }

 private:
  CirculationOptions options_;
  std::size_t capacity_;
  int cell_rows_;
  int cell_cols_;
  int n_cells_ = 0;
  Image<std::uint8_t> missing_;  // one cell wider than the array on every side
  std::vector<float> threshold_;
};

/// Finds the vortices of one frame, in raster order; `vortices` is cleared first.
///
/// A cell is a vortex if |D| > z·σ_D and |D| ≥ min_circulation_rad, if no neighbour that passes
/// this test with the same sign has a larger |D| (of equals the first in raster order stays), and
/// if it is not a lobe of a stronger opposite neighbour. z follows from the stated rate and from
/// the number of cells that are valid in this frame.
///
/// The position is the centroid of the same-sign D of the 3×3 cells, each less its own σ_D and 5 %
/// of the peak. This keeps noise from pulling the position to the centre and takes away most of the
/// bias (the rms error for an isolated round vortex is .02 w without noise). The position is within
/// ±1 of the cell's centre. Missing cells are left out, which pulls the position away from them by
/// .2 w rms; the flags say so.
///
/// σ_D may be 0. Then min_circulation_rad alone decides, and the significance is kMaxSignificance.
void find_circulation_vortices(const CirculationPlan& plan, const CirculationMap& map,
                               VortexList& vortices) noexcept;

}  // namespace curlew
