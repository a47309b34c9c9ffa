// The inner loops of the scout: what it gets of a row of nodes.
#pragma once

namespace curlew {

inline constexpr int kScoutFeatures = 10;
/// Rows of nodes are padded to a multiple of this, and maps that they are read from by as many.
inline constexpr int kScoutLanes = 16;

/// Where a row of nodes begins in the maps; node c lies between columns c and c + 1 of lenslets.
struct ScoutRow {
  const float* circulation_above;  ///< rad; column 0 is that of node −1
  const float* circulation;
  const float* circulation_below;
  const float* brightness_above;  ///< of lenslets
  const float* brightness_below;
  const float* spread_above;
  const float* spread_below;
  const float* noise;  ///< of nodes
};

/// Fills features [kScoutFeatures, n], n a multiple of kScoutLanes: 1, |D|, then relative to the
/// sign of D its sums over the four nearest and the four diagonal nodes, the largest |sum of D|
/// round one of the node's four lenslets; of these lenslets the darkest and the sum of the
/// brightness, the widest and the sum of the spread; the noise. A node's mirror images have the
/// same.
void scout_features(const ScoutRow& row, int n, float* features) noexcept;

}  // namespace curlew
