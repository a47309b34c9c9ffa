// Vortices from circulation: what stands out of the noise, where, and how surely.
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
  /// Mean number of vortices reported per frame where there is only slope noise. More than 0.
  double false_alarms_per_frame = 0.01;
  /// Cells with |D| below this are never vortices, however small the noise; more than 0. A vortex
  /// next to its opposite still shows .1 rad when they are 1/30 pitch apart (D ≈ 3.15·s for a
  /// dipole of separation s), while rounding and the smooth phase's fourth derivative stay below
  /// in noise-free data.
  double min_circulation_rad = 0.1;
  /// A cell is taken for a lobe of another vortex if an opposite neighbour is so strong that |D| is
  /// below this fraction of it; in [0, 1). The kernel's own lobes reach .093 of their strongest
  /// neighbour for a round vortex at any position, .12 for an elongated one at its peak.
  double lobe_fraction = 0.15;
};

/// All that follows from the options and the pupil. Const after construction, shared by threads.
class CirculationPlan {
 public:
  /// lenslet_valid: [rows, cols], nonzero where the sensor has a lenslet. capacity: the most
  /// vortices a frame may have; VortexList counts what is more. Throws UsageError on options out
  /// of range and Failure on fewer than 2×2 lenslets.
  CirculationPlan(const CirculationOptions& options, const Image<std::uint8_t>& lenslet_valid,
                  std::size_t capacity);

  const CirculationOptions& options() const { return options_; }
  std::size_t capacity() const { return capacity_; }
  int cell_rows() const { return cell_rows_; }
  int cell_cols() const { return cell_cols_; }
  int n_cells() const { return n_cells_; }  ///< cells whose four lenslets the sensor has

  /// Threshold on |D|/σ_D for a frame with n_valid valid cells, n_valid in [0, cells of the array].
  float threshold_sigmas(int n_valid) const {
    return threshold_[static_cast<std::size_t>(n_valid)];
  }

  /// Flags of a vortex that has cell (row, col) for a neighbour when that cell is not valid in a
  /// frame. row in [−1, cell_rows], col in [−1, cell_cols]: the array's surroundings count too.
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

/// Vortices of one frame, in raster order; `vortices` is cleared first.
///
/// A cell is a vortex if |D| > z·σ_D and |D| ≥ min_circulation_rad, no neighbour that passes the
/// same test with the same sign has a larger |D| (of equals the first in raster order stays), and
/// it is no lobe of a stronger opposite neighbour. z follows from the stated rate and the number of
/// cells valid in this frame.
/// The position is the centroid of the 3×3 cells' same-sign D, each less its own σ_D and 5 % of the
/// peak: that keeps noise from drawing it to the centre and takes most of the bias (rms error for
/// an isolated round vortex .02 w without noise). It is within ±1 of the cell's centre. Cells that
/// are missing are left out, which draws the position away from them by .2 w rms; the flags say so.
/// σ_D = 0 is lawful: then min_circulation_rad alone decides and significance is kMaxSignificance.
void find_circulation_vortices(const CirculationPlan& plan, const CirculationMap& map,
                               VortexList& vortices) noexcept;

}  // namespace curlew
