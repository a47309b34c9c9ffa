#include "service/results/beam_figures.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

namespace curlew {
namespace {

constexpr double kContour = 0.1353352832366127;  // e⁻²

/// The rectangle round the lit lenslets.
struct LitBox {
  int left = std::numeric_limits<int>::max();
  int right = std::numeric_limits<int>::min();
  int top = std::numeric_limits<int>::max();
  int bottom = std::numeric_limits<int>::min();
};

/// Marks the first and the last lit lenslet of each row in the map, and returns the box.
LitBox mark_rim(const Image<std::uint8_t>& lit, Image<std::uint8_t>& rim) {
  LitBox box;
  std::vector<int> first(static_cast<std::size_t>(lit.cols()), -1);
  std::vector<int> last = first;
  for (int row = 0; row < lit.rows(); ++row) {
    int from = -1;
    int to = -1;
    for (int col = 0; col < lit.cols(); ++col) {
      if (lit(row, col) == 0) continue;
      if (from < 0) from = col;
      to = col;
      int& top = first[static_cast<std::size_t>(col)];
      if (top < 0) top = row;
      last[static_cast<std::size_t>(col)] = row;
    }
    if (from < 0) continue;
    rim(row, from) = rim(row, to) = 1;
    box = {std::min(box.left, from), std::max(box.right, to), std::min(box.top, row), row};
  }
  for (int col = 0; col < lit.cols(); ++col) {
    const auto c = static_cast<std::size_t>(col);
    if (first[c] >= 0) rim(first[c], col) = rim(last[c], col) = 1;
  }
  return box;
}

/// Says whether a lenslet of the rim belongs to an edge: to the one towards which it lies from the
/// middle of the box, as the box is wide and high; corners belong to two.
bool is_at(BeamEdge edge, const LitBox& box, int row, int col) {
  const double x = (2.0 * col - box.left - box.right) / std::max(box.right - box.left, 1);
  const double y = (2.0 * row - box.top - box.bottom) / std::max(box.bottom - box.top, 1);
  switch (edge) {
    case BeamEdge::kLeft:
      return -x >= std::abs(y);
    case BeamEdge::kRight:
      return x >= std::abs(y);
    case BeamEdge::kTop:
      return -y >= std::abs(x);
    case BeamEdge::kBottom:
      return y >= std::abs(x);
  }
  return false;
}

/// Calls act(row, col, light) for each lenslet that counts.
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
  Image<std::uint8_t> is_rim(lit.rows(), lit.cols());
  const LitBox box = mark_rim(lit, is_rim);
  double brightest = 0.0;
  double rim = 0.0;
  for_each_light(light, lit, [&](int row, int col, double here) {
    beam.light += here;
    beam.x += here * col;
    beam.y += here * row;
    brightest = std::max(brightest, here);
    if (is_rim(row, col) == 0) return;
    rim += here;
    for (std::size_t i = 0; i < beam.edge.size(); ++i)
      if (is_at(static_cast<BeamEdge>(i), box, row, col))
        beam.edge[i] = std::max(beam.edge[i], here);
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
