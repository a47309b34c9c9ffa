// The numeric factor of one frame's weights. Highway compiles this file once for every instruction
// set and chooses one at run time.
#include "reconstruct/network_factor.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "reconstruct/network_factor.cpp"
#include "hwy/foreach_target.h"
// Highway needs foreach_target.h before the header below.

#include <algorithm>
#include <cmath>
#include <cstring>

#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace curlew::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::CappedTag<float, NetworkFactor::kLanes>;
using V = hn::Vec<D>;
constexpr D d;
constexpr std::size_t kLanes = NetworkFactor::kLanes;
constexpr std::int32_t kPanel = 8;  // pivots whose effect on later columns is added in one pass

/// Returns 1/√pivot, and 0 where the pivot is 0.
HWY_INLINE V scale_of(V pivot) {
  const auto linked = hn::Gt(pivot, hn::Zero(d));
  const V safe = hn::IfThenElse(linked, pivot, hn::Set(d, 1.0F));
  return hn::IfThenElseZero(linked, hn::Div(hn::Set(d, 1.0F), hn::Sqrt(safe)));
}

/// Eliminates the nodes inside the tiles of a batch. `entries` are the columns of L, and `rests`
/// the conductances that are left between the border's nodes, all [entry, lane].
void eliminate_tiles(const NetworkFactor::Steps& steps, std::size_t batch, const float* weight,
                     float* entries, float* scales, float* rests) {
  const std::size_t lanes = hn::Lanes(d);
  const auto n_entries = static_cast<std::size_t>(steps.entries);
  const auto n_pairs = static_cast<std::size_t>(TileShape::kBorder * (TileShape::kBorder - 1) / 2);
  std::memset(entries, 0, n_entries * kLanes * sizeof(float));
  std::memset(rests, 0, n_pairs * kLanes * sizeof(float));
  const std::size_t n_edges = steps.edge_entry.size();
  const std::int32_t* from = steps.edge_weight.data() + batch * n_edges * kLanes;
  for (std::size_t e = 0; e < n_edges; ++e) {
    float* to = entries + static_cast<std::size_t>(steps.edge_entry[e]) * kLanes;
    for (std::size_t lane = 0; lane < kLanes; ++lane) to[lane] = weight[from[e * kLanes + lane]];
  }
  for (std::size_t lane = 0; lane < kLanes; lane += lanes) {
    const auto place = [&](std::int32_t entry) HWY_ATTR {
      const auto i = static_cast<std::size_t>(entry);
      return i < n_entries ? entries + i * kLanes + lane : rests + (i - n_entries) * kLanes + lane;
    };
    for (std::size_t i = 0; i < steps.pivots.size(); ++i) {
      const NetworkFactor::TilePivot& pivot = steps.pivots[i];
      float* column = entries + static_cast<std::size_t>(pivot.first) * kLanes + lane;
      const auto size = static_cast<std::size_t>(pivot.size);
      V sum = hn::Load(d, column);
      for (std::size_t a = 1; a < size; ++a) sum = hn::Add(sum, hn::Load(d, column + a * kLanes));
      const V scale = scale_of(sum);
      hn::Store(scale, d, scales + i * kLanes + lane);
      for (std::size_t a = 0; a < size; ++a)
        hn::Store(hn::Mul(hn::Load(d, column + a * kLanes), scale), d, column + a * kLanes);
      const std::int32_t* target = steps.targets.data() + pivot.target;
      for (std::size_t b = 0; b < size; ++b) {
        const V factor = hn::Load(d, column + b * kLanes);
        for (std::size_t a = b + 1; a < size; ++a) {
          float* to = place(*target++);
          hn::Store(hn::MulAdd(factor, hn::Load(d, column + a * kLanes), hn::Load(d, to)), d, to);
        }
      }
    }
  }
}

/// These are the columns of one front in memory.
struct Columns {
  float* panel;
  float* rest;
  std::size_t stride;
  std::size_t pivots;

  float* operator[](std::size_t column) const {
    return column < pivots ? panel + column * stride : rest + (column - pivots) * stride;
  }
};

/// Sums up in a front the weights of its own edges, and what its tiles and children leave.
void assemble(const NetworkFactor::Steps& steps, const NetworkFactor::LineFront& line,
              const Columns& columns, const float* weight, const float* rests,
              const float* fronts) {
  constexpr std::size_t kPairs = std::size_t{TileShape::kBorder} * (TileShape::kBorder - 1) / 2;
  std::memset(columns.panel, 0, columns.stride * columns.pivots * sizeof(float));
  std::memset(columns.rest, 0,
              columns.stride * static_cast<std::size_t>(line.border) * sizeof(float));
  for (std::int32_t l = line.first_link; l < line.last_link; ++l) {
    const auto& link = steps.links[static_cast<std::size_t>(l)];
    columns.panel[link.place] += weight[link.weight];
  }
  for (std::int32_t t = line.first_tile; t < line.last_tile; ++t) {
    const auto& tile = steps.tile_rests[static_cast<std::size_t>(t)];
    const float* from = rests + static_cast<std::size_t>(tile.tile) / kLanes * kPairs * kLanes +
                        static_cast<std::size_t>(tile.tile) % kLanes;
    const NetworkFactor::BorderRow* row = steps.border_rows.data();
    for (std::int32_t j = tile.first; j < tile.last; ++j) {
      float* to = columns[static_cast<std::size_t>(row[j].row)];
      const std::int32_t* pair = steps.pair[static_cast<std::size_t>(row[j].node)].data();
      for (std::int32_t i = j + 1; i < tile.last; ++i)
        to[row[i].row] += from[static_cast<std::size_t>(pair[row[i].node]) * kLanes];
    }
  }
  for (std::int32_t c = line.first_child; c < line.last_child; ++c) {
    const auto& child = steps.children[static_cast<std::size_t>(c)];
    const auto& front = steps.lines[static_cast<std::size_t>(child.line)];
    for (std::int32_t j = 0; j < front.border; ++j) {
      const float* from = fronts + front.rest +
                          static_cast<std::size_t>(j) * static_cast<std::size_t>(front.stride) +
                          static_cast<std::size_t>(front.pivots);
      float* to = columns[static_cast<std::size_t>(
          steps.child_rows[static_cast<std::size_t>(child.first_row) +
                           static_cast<std::size_t>(j)])];
      for (std::int32_t r = child.first_run; r < child.last_run; ++r) {
        const auto& run = steps.runs[static_cast<std::size_t>(r)];
        if (run.from + run.size <= j) continue;  // It is above the diagonal.
        for (std::int32_t i = 0; i < run.size; ++i) to[run.to + i] += from[run.from + i];
      }
    }
  }
}

/// Returns the first row of the vector that holds a row.
HWY_INLINE std::size_t vector_of(std::size_t row) { return row / hn::Lanes(d) * hn::Lanes(d); }

/// Eliminates pivots [first, last), which are few, from each other's columns.
void eliminate_panel(const Columns& columns, std::size_t first, std::size_t last, float* scales) {
  const std::size_t lanes = hn::Lanes(d);
  for (std::size_t j = first; j < last; ++j) {
    float* column = columns.panel + j * columns.stride;
    // What the steps before have left on the diagonal and above it is not needed.
    const std::size_t start = vector_of(j);
    const auto below = hn::Gt(hn::Iota(d, 0.0F), hn::Set(d, static_cast<float>(j - start)));
    V sum = hn::IfThenElseZero(below, hn::Load(d, column + start));
    hn::Store(sum, d, column + start);
    for (std::size_t i = start + lanes; i < columns.stride; i += lanes)
      sum = hn::Add(sum, hn::Load(d, column + i));
    const V scale = scale_of(hn::SumOfLanes(d, sum));
    scales[j] = hn::GetLane(scale);
    for (std::size_t i = start; i < columns.stride; i += lanes)
      hn::Store(hn::Mul(hn::Load(d, column + i), scale), d, column + i);
    for (std::size_t k = j + 1; k < last; ++k) {
      const V factor = hn::Set(d, column[k]);
      float* to = columns.panel + k * columns.stride;
      for (std::size_t i = vector_of(k); i < columns.stride; i += lanes)
        hn::Store(hn::MulAdd(factor, hn::Load(d, column + i), hn::Load(d, to + i)), d, to + i);
    }
  }
}

/// Adds the effect of pivots [first, last) to kColumns columns from `column` on, kVectors vectors
/// at a time from `row` on, and returns the next row.
template <std::size_t kColumns, std::size_t kVectors>
HWY_INLINE std::size_t update_rows(const Columns& columns, std::size_t first, std::size_t last,
                                   std::size_t column, std::size_t row) {
  const std::size_t lanes = hn::Lanes(d);
  for (; row + kVectors * lanes <= columns.stride; row += kVectors * lanes) {
    V sum[kColumns][kVectors];
    for (std::size_t k = 0; k < kColumns; ++k)
      for (std::size_t v = 0; v < kVectors; ++v)
        sum[k][v] = hn::Load(d, columns[column + k] + row + v * lanes);
    for (std::size_t j = first; j < last; ++j) {
      const float* pivot = columns.panel + j * columns.stride;
      V x[kVectors];
      for (std::size_t v = 0; v < kVectors; ++v) x[v] = hn::Load(d, pivot + row + v * lanes);
      for (std::size_t k = 0; k < kColumns; ++k) {
        const V factor = hn::Set(d, pivot[column + k]);
        for (std::size_t v = 0; v < kVectors; ++v) sum[k][v] = hn::MulAdd(factor, x[v], sum[k][v]);
      }
    }
    for (std::size_t k = 0; k < kColumns; ++k)
      for (std::size_t v = 0; v < kVectors; ++v)
        hn::Store(sum[k][v], d, columns[column + k] + row + v * lanes);
  }
  return row;
}

template <std::size_t kColumns>
HWY_INLINE void update_columns(const Columns& columns, std::size_t first, std::size_t last,
                               std::size_t column) {
  const std::size_t row = update_rows<kColumns, 2>(columns, first, last, column, vector_of(column));
  update_rows<kColumns, 1>(columns, first, last, column, row);
}

void eliminate_front(const Columns& columns, std::size_t rows, float* scales) {
  for (std::size_t first = 0; first < columns.pivots; first += kPanel) {
    const std::size_t last = std::min<std::size_t>(first + kPanel, columns.pivots);
    eliminate_panel(columns, first, last, scales);
    std::size_t column = last;
    for (; column + 4 <= rows; column += 4) update_columns<4>(columns, first, last, column);
    for (; column < rows; ++column) update_columns<1>(columns, first, last, column);
  }
}

void factorise(const NetworkFactor::Steps& steps, const float* weight,
               NetworkFactor::Workspace& ws) {
  constexpr std::size_t kPairs = std::size_t{TileShape::kBorder} * (TileShape::kBorder - 1) / 2;
  for (std::size_t batch = 0; batch < static_cast<std::size_t>(steps.batches); ++batch) {
    eliminate_tiles(steps, batch, weight,
                    ws.tiles.data() + batch * static_cast<std::size_t>(steps.entries) * kLanes,
                    ws.tile_scales.data() + batch * TileShape::kInside * kLanes,
                    ws.rests.data() + batch * kPairs * kLanes);
  }
  for (const NetworkFactor::LineFront& line : steps.lines) {
    const Columns columns{ws.panels.data() + line.panel, ws.fronts.data() + line.rest,
                          static_cast<std::size_t>(line.stride),
                          static_cast<std::size_t>(line.pivots)};
    assemble(steps, line, columns, weight, ws.rests.data(), ws.fronts.data());
    eliminate_front(columns,
                    static_cast<std::size_t>(line.pivots) + static_cast<std::size_t>(line.border),
                    ws.scales.data() + line.first);
  }
}

}  // namespace
}  // namespace curlew::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace curlew {

HWY_EXPORT(factorise);

void NetworkFactor::factorise(const float* weight, Workspace& workspace) const noexcept {
  HWY_DYNAMIC_DISPATCH(factorise)(steps_, weight, workspace);
}

}  // namespace curlew
#endif  // HWY_ONCE
