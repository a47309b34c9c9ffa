#include "service/results/beam_figures.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

namespace curlew {
namespace {

constexpr double kContour = 0.1353352832366127;  // e⁻²

/// Returns 1 where a lit lenslet is the first or the last one of its row or of its column: a bit
/// for each edge.
Image<std::uint8_t> rims_of(const Image<std::uint8_t>& lit) {
  const auto bit = [](BeamEdge edge) {
    return static_cast<std::uint8_t>(1U << static_cast<unsigned>(edge));
  };
  Image<std::uint8_t> rims(lit.rows(), lit.cols());
  const auto mark = [&](int outer, int inner, auto&& at, BeamEdge first, BeamEdge last) {
    for (int i = 0; i < outer; ++i) {
      int from = 0;
      while (from < inner && at(lit, i, from) == 0) ++from;
      if (from == inner) continue;
      int to = inner - 1;
      while (at(lit, i, to) == 0) --to;
      at(rims, i, from) |= bit(first);
      at(rims, i, to) |= bit(last);
    }
  };
  mark(
      lit.rows(), lit.cols(), [](auto& map, int row, int col) -> auto& { return map(row, col); },
      BeamEdge::kLeft, BeamEdge::kRight);
  mark(
      lit.cols(), lit.rows(), [](auto& map, int col, int row) -> auto& { return map(row, col); },
      BeamEdge::kTop, BeamEdge::kBottom);
  return rims;
}

/// Calls act(k, row, col, light) for each lenslet that counts.
template <typename Act>
void for_each_light(const Image<float>& light, const Image<std::uint8_t>& lit, Act&& act) {
  for (int row = 0; row < lit.rows(); ++row)
    for (int col = 0; col < lit.cols(); ++col)
      if (lit(row, col) != 0 && light(row, col) > 0.0F)
        act(row, col, static_cast<double>(light(row, col)));
}

}  // namespace

BeamFigures measure_beam(const Image<float>& light, const Image<std::uint8_t>& lit) {
  BeamFigures beam;
  const Image<std::uint8_t> rims = rims_of(lit);
  double brightest = 0.0;
  double rim = 0.0;
  for_each_light(light, lit, [&](int row, int col, double here) {
    beam.light += here;
    beam.x += here * col;
    beam.y += here * row;
    brightest = std::max(brightest, here);
    if (rims(row, col) != 0) rim += here;
    for (std::size_t i = 0; i < beam.edge.size(); ++i)
      if ((rims(row, col) >> i & 1U) != 0) beam.edge[i] = std::max(beam.edge[i], here);
  });
  if (!beam.is_lit()) {
    beam.x = beam.y = beam.d4sigma_x = beam.d4sigma_y = beam.rim =
        std::numeric_limits<double>::quiet_NaN();
    beam.edge.fill(beam.x);
    return beam;
  }
  beam.x /= beam.light;
  beam.y /= beam.light;
  beam.rim = rim / beam.light;
  for (double& edge : beam.edge) edge /= brightest;
  double xx = 0.0;
  double yy = 0.0;
  for_each_light(light, lit, [&](int row, int col, double here) {
    xx += here * (col - beam.x) * (col - beam.x);
    yy += here * (row - beam.y) * (row - beam.y);
  });
  beam.d4sigma_x = 4.0 * std::sqrt(xx / beam.light);
  beam.d4sigma_y = 4.0 * std::sqrt(yy / beam.light);
  return beam;
}

BeamFigures measure_beam(const Image<float>& flux_adu, const Image<LensletState>& state) {
  Image<float> light = flux_adu;
  Image<std::uint8_t> lit(state.rows(), state.cols());
  for (std::size_t k = 0; k < state.size(); ++k) {
    lit[k] = state[k] == LensletState::kUnlit ? 0 : 1;
    if (state[k] == LensletState::kFaint) light[k] = 0.0F;
  }
  return measure_beam(light, lit);
}

std::string edges_that_cut(const BeamFigures& beam, const BeamFigures& reference) {
  if (!beam.is_lit() || !reference.is_lit()) return {};
  std::string edges;
  const auto look = [&](BeamEdge low, BeamEdge high, double moved, double sigma) {
    const auto l = static_cast<std::size_t>(low);
    const auto h = static_cast<std::size_t>(high);
    const bool filled = reference.edge[l] >= kContour && reference.edge[h] >= kContour;
    for (const std::size_t side : {l, h}) {
      const double outwards = side == l ? -moved : moved;
      const bool lost = filled ? outwards > sigma / 2.0
                               : beam.edge[side] >= kContour && reference.edge[side] < kContour;
      if (lost) edges.append(edges.empty() ? "" : " and ").append(kBeamEdgeNames[side]);
    }
  };
  look(BeamEdge::kLeft, BeamEdge::kRight, beam.x - reference.x, reference.d4sigma_x / 4.0);
  look(BeamEdge::kTop, BeamEdge::kBottom, beam.y - reference.y, reference.d4sigma_y / 4.0);
  return edges;
}

}  // namespace curlew
