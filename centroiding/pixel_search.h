// Lists the pixels of a frame that may be no light, by tests that are fast and let too many
// through.
#pragma once

#include <cstdint>

#include "centroiding/sharp_pixels.h"
#include "core/fixed_list.h"
#include "core/frame.h"

namespace curlew {

/// This is what all pixels are held against first, in whole counts. It lets through all that is
/// sharp or in a bright line and little else. A pixel passes if its count exceeds that of its
/// brighter neighbour n along one of the axes by more than margin + max(steepness·n − dark, 0). It
/// also passes if its count is less than `dead`, and one of its neighbours has more than `lit`.
struct RoughFaults {
  std::uint16_t whole_steepness;  ///< steepness is sharpness − 1
  std::uint16_t steepness;        ///< the rest of it, in 1/65536
  std::uint16_t dark;             ///< steepness times the frame's highest dark level, rounded up
  std::uint16_t margin;
  std::uint16_t dead;
  std::uint16_t lit;
};

/// A pixel passes if n, the count of its brighter neighbour two pixels away along one of the axes,
/// is less than inverse·count + dark, and less than its count by more than `margin`.
struct RoughClumps {
  std::uint16_t inverse;  ///< of the sharpness, in 1/65536
  std::uint16_t dark;     ///< the frame's highest dark level times 1 − inverse, rounded up
  std::uint16_t margin;
};

/// counts_per_e: as CentroidPlan has it.
RoughFaults rough_faults(const SharpPixelPlan& plan, const FrameLevels& levels,
                         float counts_per_e) noexcept;
RoughClumps rough_clumps(const SharpPixelPlan& plan, const FrameLevels& levels,
                         float counts_per_e) noexcept;

/// Adds those of rows [first_row, last_row) that pass to `found`, but for the pixels of the frame's
/// rim, which have too few neighbours. first_row is at least 1 and last_row at most the frame's
/// rows less 1; for clumps 2. Of a very narrow frame's first rows nothing is found.
void search_faults(FrameView frame, int first_row, int last_row, RoughFaults test,
                   FixedList<SharpPixel>& found) noexcept;
void search_clumps(FrameView frame, int first_row, int last_row, RoughClumps test,
                   FixedList<SharpPixel>& found) noexcept;

}  // namespace curlew
