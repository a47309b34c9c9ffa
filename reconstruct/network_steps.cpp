#include <algorithm>

#include "reconstruct/network_factor.h"

namespace curlew {
namespace {

constexpr int kPairs = TileShape::kBorder * (TileShape::kBorder - 1) / 2;

std::int32_t size_of(const auto& list) { return static_cast<std::int32_t>(list.size()); }

}  // namespace

NetworkFactor::NetworkFactor(const Dissection& dissection, const SplitGrid& grid) {
  steps_.nodes = dissection.n_nodes();
  plan_tile(dissection.shape());
  plan_batches(dissection, grid);
  plan_lines(dissection, grid);
  plan_rests();
}

/// Numbers the entries of L in a tile, and finds the entries that each elimination changes.
void NetworkFactor::plan_tile(const TileShape& shape) {
  for (std::size_t i = 0; i < shape.later.size(); ++i) {
    steps_.pivots[i] = {size_of(steps_.entry_row), size_of(shape.later[i]), 0};
    steps_.entry_row.insert(steps_.entry_row.end(), shape.later[i].begin(), shape.later[i].end());
  }
  steps_.entries = size_of(steps_.entry_row);
  std::int32_t pairs = 0;
  for (std::size_t a = 0; a < TileShape::kBorder; ++a)
    for (std::size_t b = 0; b < a; ++b) steps_.pair[a][b] = steps_.pair[b][a] = pairs++;
  const auto entry = [&](int column, int row) {
    if (column >= TileShape::kInside)
      return steps_.entries +
             steps_.pair[as_size(column - TileShape::kInside)][as_size(row - TileShape::kInside)];
    const std::vector<int>& rows = shape.later[as_size(column)];
    const auto place = std::lower_bound(rows.begin(), rows.end(), row) - rows.begin();
    return steps_.pivots[as_size(column)].first + static_cast<std::int32_t>(place);
  };
  for (std::size_t i = 0; i < shape.later.size(); ++i) {
    steps_.pivots[i].target = size_of(steps_.targets);
    const std::vector<int>& rows = shape.later[i];
    for (std::size_t b = 0; b < rows.size(); ++b)
      for (std::size_t a = b + 1; a < rows.size(); ++a)
        steps_.targets.push_back(entry(rows[b], rows[a]));
  }
  for (const TileShape::Edge& edge : shape.edges)
    steps_.edge_entry.push_back(entry(edge.from, edge.to));
}

/// Finds the weights and nodes of the tiles. A lane without a tile has weight 0 everywhere, which
/// is what the first place of the grid holds.
void NetworkFactor::plan_batches(const Dissection& dissection, const SplitGrid& grid) {
  const TileShape& shape = dissection.shape();
  const auto n_tiles = size_of(dissection.tiles());
  steps_.batches = (n_tiles + kLanes - 1) / kLanes;
  const std::size_t n_edges = shape.edges.size();
  steps_.edge_weight.assign(as_size(steps_.batches) * kLanes * n_edges, 0);
  steps_.tile_position.assign(as_size(steps_.batches) * kLanes * TileShape::kNodes, steps_.nodes);
  for (std::int32_t t = 0; t < n_tiles; ++t) {
    const Dissection::Tile& tile = dissection.tiles()[as_size(t)];
    const std::size_t batch = as_size(t / kLanes);
    const std::size_t lane = as_size(t % kLanes);
    for (std::size_t e = 0; e < n_edges; ++e) {
      const TileShape::Edge& edge = shape.edges[e];
      const int k = dissection.lenslet_of(tile.parity, tile.u + edge.start.u, tile.v + edge.start.v,
                                          edge.along_u);
      if (k >= 0)
        steps_.edge_weight[(batch * n_edges + e) * kLanes + lane] =
            static_cast<std::int32_t>(grid.lenslet(k));
    }
    for (std::size_t i = 0; i < TileShape::kNodes; ++i)
      steps_.tile_position[(batch * TileShape::kNodes + i) * kLanes + lane] =
          dissection.position_of(tile.parity, tile.u + shape.place[i].u, tile.v + shape.place[i].v);
  }
  operations_ += static_cast<double>(steps_.batches * kLanes) *
                 static_cast<double>(steps_.targets.size() + as_size(steps_.entries));
}

void NetworkFactor::plan_lines(const Dissection& dissection, const SplitGrid& grid) {
  const std::vector<Front>& fronts = dissection.fronts();
  std::vector<std::int32_t> line_of(fronts.size(), -1);
  std::vector<std::vector<Dissection::Link>> links(fronts.size());
  for (const Dissection::Link& link : dissection.links())
    links[as_size(dissection.front_of()[as_size(link.from)])].push_back(link);
  for (std::size_t f = 0; f < fronts.size(); ++f) {
    const Front& front = fronts[f];
    if (front.tile >= 0) continue;
    line_of[f] = size_of(steps_.lines);
    LineFront line{};
    line.first = front.first;
    line.pivots = front.pivots;
    line.border = size_of(front.border);
    line.stride = (front.rows() + 15) / 16 * 16;
    line.panel = steps_.panel_size;
    steps_.panel_size += as_size(line.stride) * as_size(line.pivots);
    steps_.longest = std::max(steps_.longest, line.stride);
    line.first_border = size_of(steps_.borders);
    steps_.borders.insert(steps_.borders.end(), front.border.begin(), front.border.end());
    line.first_link = size_of(steps_.links);
    for (const Dissection::Link& link : links[f])
      steps_.links.push_back({front.row_of(link.from) * line.stride + front.row_of(link.to),
                              static_cast<std::int32_t>(grid.lenslet(link.lenslet))});
    line.last_link = size_of(steps_.links);
    steps_.lines.push_back(line);
    const double rows = front.rows();
    operations_ += 0.5 * rows * rows * front.pivots;
  }
  plan_children(dissection, line_of);
}

/// Finds what fronts pass on to their parents.
void NetworkFactor::plan_children(const Dissection& dissection,
                                  const std::vector<std::int32_t>& line_of) {
  const std::vector<Front>& fronts = dissection.fronts();
  std::vector<std::vector<std::size_t>> children(fronts.size());
  for (std::size_t f = 0; f < fronts.size(); ++f)
    if (fronts[f].parent >= 0) children[as_size(fronts[f].parent)].push_back(f);
  for (std::size_t f = 0; f < fronts.size(); ++f) {
    if (line_of[f] < 0) continue;
    LineFront& line = steps_.lines[as_size(line_of[f])];
    line.first_tile = size_of(steps_.tile_rests);
    line.first_child = size_of(steps_.children);
    for (const std::size_t c : children[f]) {
      const Front& child = fronts[c];
      if (child.tile >= 0) {
        TileRest rest{child.tile, size_of(steps_.border_rows), 0};
        const std::int32_t* positions =
            &steps_.tile_position[as_size(child.tile / kLanes * TileShape::kNodes +
                                          TileShape::kInside) *
                                      kLanes +
                                  as_size(child.tile % kLanes)];
        for (const std::int32_t position : child.border)
          for (std::int32_t i = 0; i < TileShape::kBorder; ++i)
            if (positions[std::ptrdiff_t{i} * kLanes] == position)
              steps_.border_rows.push_back({i, fronts[f].row_of(position)});
        rest.last = size_of(steps_.border_rows);
        steps_.tile_rests.push_back(rest);
        continue;
      }
      Child entry{line_of[c], size_of(steps_.runs), 0, size_of(steps_.child_rows)};
      for (std::int32_t i = 0; i < size_of(child.border); ++i) {
        const std::int32_t row = fronts[f].row_of(child.border[as_size(i)]);
        steps_.child_rows.push_back(row);
        const bool goes_on = size_of(steps_.runs) > entry.first_run &&
                             steps_.runs.back().to + steps_.runs.back().size == row;
        if (goes_on)
          ++steps_.runs.back().size;
        else
          steps_.runs.push_back({i, row, 1});
      }
      entry.last_run = size_of(steps_.runs);
      steps_.children.push_back(entry);
    }
    line.last_tile = size_of(steps_.tile_rests);
    line.last_child = size_of(steps_.children);
  }
}

/// Gives each front's rest the first place that is free from its own turn to its parent's.
void NetworkFactor::plan_rests() {
  struct Used {
    std::size_t first, last;
    std::int32_t line;
  };
  std::vector<Used> used;  // ascending
  for (std::int32_t l = 0; l < size_of(steps_.lines); ++l) {
    LineFront& line = steps_.lines[as_size(l)];
    const std::size_t size = as_size(line.stride) * as_size(line.border);
    auto next = used.begin();
    line.rest = 0;
    for (; next != used.end() && line.rest + size > next->first; ++next) line.rest = next->last;
    used.insert(next, {line.rest, line.rest + size, l});
    steps_.rest_size = std::max(steps_.rest_size, line.rest + size);
    for (std::int32_t c = line.first_child; c < line.last_child; ++c)
      std::erase_if(used,
                    [&](const Used& u) { return u.line == steps_.children[as_size(c)].line; });
  }
}

NetworkFactor::Workspace::Workspace(const NetworkFactor& factor) {
  const Steps& steps = factor.steps();
  const std::size_t lanes = as_size(steps.batches) * kLanes;
  tiles.resize(lanes * as_size(steps.entries));
  tile_scales.resize(lanes * TileShape::kInside);
  rests.resize(lanes * kPairs);
  panels.resize(steps.panel_size);
  scales.resize(as_size(steps.nodes));
  fronts.resize(steps.rest_size);
  vector.resize(as_size(steps.longest + 16));
}

}  // namespace curlew
