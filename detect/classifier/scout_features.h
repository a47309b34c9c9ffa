// This file declares the inner loops of the scout, which describe a row of nodes.
#pragma once

namespace curlew {

inline constexpr int kScoutFeatures = 10;
/// Rows of nodes are padded to a multiple of this. The maps from which they are read are padded by
/// as many.
inline constexpr int kScoutLanes = 16;

/// Says where a row of nodes begins in the maps. Node c lies between columns c and c + 1 of
/// lenslets.
struct ScoutRow {
  const float* circulation_above;  ///< rad; column 0 belongs to node −1
  const float* circulation;
  const float* circulation_below;
  const float* brightness_above;  ///< brightness of lenslets
  const float* brightness_below;
  const float* spread_above;
  const float* spread_below;
  const float* noise;  ///< noise of nodes
};

/// Fills features [kScoutFeatures, n] of n nodes, where n is a multiple of kScoutLanes. The
/// features are 1; |D|; the sums of D over the four nearest and over the four diagonal nodes, both
/// relative to the sign of the node's D; and the largest |sum of D| round one of the node's four
/// lenslets. Then come the least and the sum of these lenslets' brightness, the largest and the sum
/// of their spread, and the noise. All mirror images of a node have the same features.
void scout_features(const ScoutRow& row, int n, float* features) noexcept;

}  // namespace curlew
