// Marks what the windows of a row of lenslets hold, for SpotJudge.
#pragma once

#include <cstddef>
#include <cstdint>

#include "centroiding/low_orders.h"

namespace curlew {

// What a lenslet's window holds, where it is not 0.
inline constexpr std::uint8_t kNearModel = 1;   ///< a spot near the model, but dim, glaring or wide
inline constexpr std::uint8_t kWellFormed = 2;  ///< a spot near the model
inline constexpr std::uint8_t kFarOff = 3;      ///< light too far from the model to be its spot
inline constexpr std::uint8_t kFaintSpot = 4;   ///< a faint spot, where these count

/// One axis of a row's spots, in px.
struct RowAxis {
  const float* measured;
  const float* reference;
  const float* place;  ///< of the windows
};

/// A row of n lenslets, as pointers into the maps of SpotJudge and Centroids.
struct SpotRow {
  std::size_t n;
  RowAxis x;
  RowAxis y;
  const float* column_u;  ///< the model's coordinate of each column
  const float* flux;
  const float* reference_flux;
  const float* xx;
  const float* yy;
  const float* widest;         ///< xx + yy above which a spot is not well formed
  const std::uint8_t* states;  ///< LensletState
  const std::uint8_t* lit;     ///< 1 where the lenslet had its spot in most of the last frames
};

struct SpotLimits {
  float far_px2;     ///< A spot whose distance² from the model is more is far off.
  float near_px2;    ///< One that is well formed has less.
  float typical;     ///< flux over its reference's, of spots
  bool weak_may_be;  ///< whether weak spots may be anywhere
  bool faint_count;  ///< whether faint spots count as others do
};

/// A spot's flux over its reference's, where the typical lenslet's is 1: less is stray light.
inline constexpr float kDimmest = 0.15F;

/// These are added up over all rows.
struct SpotCounts {
  int spots = 0;                  ///< that are well formed, and faint ones where these count
  int light = 0;                  ///< lenslets with light
  int faint = 0;                  ///< lenslets with faint light that is not far dimmer than others'
  int same = 0;                   ///< lit ones with a spot near the model
  int were_lit = 0;               ///< lit ones
  std::int32_t largest_bits = 0;  ///< the float whose bits these are is the model's largest, px
};

/// Sets marks[0 … n) and adds to the counts.
void mark_spots(const SpotRow& row, const LowOrders::Row& model, const SpotLimits& limits,
                std::uint8_t* marks, SpotCounts& counts) noexcept;

}  // namespace curlew
