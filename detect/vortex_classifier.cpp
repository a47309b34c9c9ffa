#include "detect/vortex_classifier.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include "core/error.h"
#include "detect/circulation.h"
#include "detect/matrix_product.h"

namespace curlew {
namespace {

constexpr int kCode = ClassifierNetwork::kCode;
constexpr std::size_t kAnswer = ClassifierNetwork::kOutputs[ClassifierNetwork::kHeadEnd - 1];
constexpr float kLeastProbability = 0.02F;  // seen from one node: below this it is nothing
constexpr float kSameVortex = 0.8F;         // pitches: vortices of one sign nearer are one
constexpr float kAgree = 0.8F;              // pitches: nodes that see it here have a say in where
constexpr float kLeastInterest = -4.0F;     // see glance()
constexpr double kEveryNode = -1e29;
constexpr float kBrightest = 16.0F;       // times the mean flux: more is all the same
constexpr float kWidestSpread = 2.0F;     // (λ/w)², likewise
constexpr float kMostCirculation = 4.0F;  // rad, likewise
constexpr int kNear = 2;                  // nodes along an axis, between views of one vortex

const ClassifierOptions& checked(const ClassifierOptions& options, const SpotCamera& camera) {
  if (!(options.min_probability > 0.0 && options.min_probability < 1.0)) {
    throw UsageError("the least probability is " + std::to_string(options.min_probability) +
                     "; give a number between 0 and 1, such as 0.5");
  }
  if (camera.windows.rows() < 2 || camera.windows.cols() < 2) {
    throw Failure("the sensor has " + std::to_string(camera.windows.rows()) + "x" +
                  std::to_string(camera.windows.cols()) +
                  " lenslets, but a vortex shows between four; use one of 2x2 or more");
  }
  return options;
}

/// Layers [first, last) of n samples in `in`, which comes out in the pointer returned. Both buffers
/// are used.
const float* apply_layers(const ClassifierNetwork& network, int first, int last, int n, float* in,
                          float* out) noexcept {
  for (int i = first; i < last; ++i) {
    const DenseLayer& layer = network.layers[static_cast<std::size_t>(i)];
    multiply({in, layer.inputs, 1}, layer.weights.data(), layer.bias.data(), n, layer.inputs,
             layer.outputs, ClassifierNetwork::rectified(i), out);
    std::swap(in, out);
  }
  return in;
}

bool is_missing(LensletState state) noexcept {
  return (state == LensletState::kUnlit) | (state == LensletState::kSaturated) |
         (state == LensletState::kBadPixels);
}

float mean_flux(const Centroids& centroids) noexcept {
  constexpr std::size_t kLanes = 8;  // side by side, so that the compiler makes vectors of them
  std::array<float, kLanes> sums{};
  std::array<float, kLanes> counts{};
  const std::size_t n = centroids.state.size();
  const auto add = [&](std::size_t k, std::size_t lane) {
    const float counted = is_missing(centroids.state[k]) ? 0.0F : 1.0F;
    sums[lane] += counted * centroids.flux_adu[k];
    counts[lane] += counted;
  };
  std::size_t k = 0;
  for (; k + kLanes <= n; k += kLanes)
    for (std::size_t lane = 0; lane < kLanes; ++lane) add(k + lane, lane);
  for (; k < n; ++k) add(k, 0);
  float sum = 0.0F;
  float count = 0.0F;
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    sum += sums[lane];
    count += counts[lane];
  }
  return count > 0.0F ? sum / count : 0.0F;
}

/// Fills the workspace's maps of brightness and spread.
void describe_lenslets(const ClassifierPlan& plan, const Centroids& centroids, float mean,
                       ClassifierWorkspace& workspace) noexcept {
  const float per_flux = 1.0F / std::max(mean, 1e-30F);
  const float per_square = 1.0F / (plan.pixels_per_lambda_w() * plan.pixels_per_lambda_w());
  const std::size_t n = workspace.brightness.size();
  const float* flux = centroids.flux_adu.data();
  const float* xx = centroids.xx_px2.data();
  const float* yy = centroids.yy_px2.data();
  float* brightness = workspace.brightness.data();
  float* spread = workspace.spread.data();
  for (std::size_t k = 0; k < n; ++k) {
    const float ratio = std::min(std::max(flux[k] * per_flux, 0.0F), kBrightest);
    brightness[k] = std::sqrt(std::sqrt(ratio));
    spread[k] = std::min((xx[k] + yy[k]) * per_square, kWidestSpread);
  }
}

/// How much a first glance at a row of nodes promises, on a scale of logits: a logistic regression
/// of what the network finds on circulation, darkness and spread (validation subset, Rytov
/// variances 1 to 4, no noise to 200 photons). Of the nodes where it finds vortices 99.6 % lie
/// above kLeastInterest, of all nodes 10 to 40 %.
void glance(const ClassifierWorkspace& workspace, const CirculationMap& circulation, int row,
            float* __restrict interest) noexcept {
  const auto n = static_cast<std::size_t>(circulation.value.cols());
  const float* d = &circulation.value(row, 0);
  const float* upper = &workspace.brightness(row, 0);
  const float* lower = &workspace.brightness(row + 1, 0);
  const float* upper_spread = &workspace.spread(row, 0);
  const float* lower_spread = &workspace.spread(row + 1, 0);
  for (std::size_t c = 0; c < n; ++c) {
    const float size = std::min(std::abs(d[c]), kMostCirculation);
    const float darkest =
        std::min(std::min(upper[c], upper[c + 1]), std::min(lower[c], lower[c + 1]));
    const float mean = upper[c] + upper[c + 1] + lower[c] + lower[c + 1];
    const float widest = std::max(std::max(upper_spread[c], upper_spread[c + 1]),
                                  std::max(lower_spread[c], lower_spread[c + 1]));
    interest[c] =
        -1.01F + (1.57F - 0.159F * size) * size - 3.69F * darkest - 1.15F * mean + 4.69F * widest;
  }
}

/// Keeps, of the nodes in the workspace, those the scout finds worth it.
void scout(const ClassifierPlan& plan, const CirculationMap& circulation,
           ClassifierWorkspace& workspace) noexcept {
  FixedList<std::int32_t>& nodes = workspace.nodes;
  const auto least = static_cast<float>(plan.options().min_scout);
  const int node_cols = plan.cols() - 1;
  const std::size_t n_glanced = nodes.size();
  std::size_t kept = 0;
  for (std::size_t first = 0; first < n_glanced; first += ClassifierWorkspace::kChunk) {
    const auto n = std::min<std::size_t>(ClassifierWorkspace::kChunk, n_glanced - first);
    for (std::size_t i = 0; i < n; ++i) {
      describe_node(workspace, circulation, nodes[first + i] / node_cols,
                    nodes[first + i] % node_cols, workspace.a.data() + i * kScoutFeatures);
    }
    const float* out =
        apply_layers(plan.network(), ClassifierNetwork::kHeadEnd, ClassifierNetwork::kLayers,
                     static_cast<int>(n), workspace.a.data(), workspace.b.data());
    constexpr std::size_t kOut = ClassifierNetwork::kOutputs.back();
    for (std::size_t i = 0; i < n; ++i)
      if (out[i * kOut] >= least) nodes[kept++] = nodes[first + i];
  }
  nodes.shorten(kept);
}

/// Which nodes to judge, and which lenslets that takes.
void choose_nodes(const ClassifierPlan& plan, const Centroids& centroids,
                  const CirculationMap& circulation, float mean,
                  ClassifierWorkspace& workspace) noexcept {
  workspace.nodes.clear();
  workspace.lenslets.clear();
  const int rows = plan.rows();
  const int cols = plan.cols();
  const bool all = plan.options().min_scout <= kEveryNode;
  describe_lenslets(plan, centroids, mean, workspace);
  for (int r = 0; r + 1 < rows; ++r) {
    glance(workspace, circulation, r, workspace.interest.data());
    for (int c = 0; c + 1 < cols; ++c) {
      if (!all && workspace.interest[static_cast<std::size_t>(c)] < kLeastInterest) continue;
      int missing = 0;
      for (int i = r; i <= r + 1; ++i)
        for (int j = c; j <= c + 1; ++j) missing += is_missing(centroids.state(i, j)) ? 1 : 0;
      if (missing <= 1) workspace.nodes.push(r * (cols - 1) + c);
    }
  }
  if (!all) scout(plan, circulation, workspace);
  workspace.wanted.fill(0);
  for (const std::int32_t node : workspace.nodes) {
    const int r = node / (cols - 1);
    const int c = node % (cols - 1);
    for (int i = std::max(r - 1, 0); i <= std::min(r + 2, rows - 1); ++i)
      for (int j = std::max(c - 1, 0); j <= std::min(c + 2, cols - 1); ++j)
        workspace.wanted(i, j) = 1;
  }
  for (int k = 0; k < rows * cols; ++k)
    if (workspace.wanted[static_cast<std::size_t>(k)] != 0) workspace.lenslets.push(k);
}

void encode_lenslets(const ClassifierPlan& plan, FrameView frame, const Centroids& centroids,
                     float mean, ClassifierWorkspace& workspace) noexcept {
  const int cols = plan.cols();
  std::array<std::int32_t, ClassifierWorkspace::kChunk> chunk{};
  int n = 0;
  const auto code_of = [&](int k) {
    return &workspace.codes(k / cols + 1, (k % cols + 1) * kCode);
  };
  const auto flush = [&] {
    const float* codes = apply_layers(plan.network(), 0, ClassifierNetwork::kEncoderEnd, n,
                                      workspace.a.data(), workspace.b.data());
    for (int i = 0; i < n; ++i)
      std::copy_n(codes + std::ptrdiff_t{i} * kCode, kCode,
                  code_of(chunk[static_cast<std::size_t>(i)]));
    n = 0;
  };
  for (const std::int32_t k : workspace.lenslets) {
    const auto u = static_cast<std::size_t>(k);
    if (is_missing(centroids.state[u]) || !plan.features().has_lenslet(u)) {
      std::copy_n(plan.missing_code(), kCode, code_of(k));
      continue;
    }
    plan.features().measure(frame, u, centroids.flux_adu[u], mean,
                            workspace.a.data() + std::ptrdiff_t{n} * kSpotFeatures);
    chunk[static_cast<std::size_t>(n++)] = k;
    if (n == ClassifierWorkspace::kChunk) flush();
  }
  if (n > 0) flush();
}

/// The network's answer for one sign, if it says anything.
void add_if_likely(const NodeOutput& output, int charge, int row, int col,
                   ClassifierWorkspace& workspace) noexcept {
  const float probability = 1.0F / (1.0F + std::exp(-output.logit));
  if (!(probability >= kLeastProbability)) return;
  const float a = std::exp(std::clamp(output.log_a, kLeastLogScale, kMostLogScale));
  const float c = std::exp(std::clamp(output.log_c, kLeastLogScale, kMostLogScale));
  const float ratio = output.b / (a * c);
  NodeVortex seen;
  seen.vortex = {.x = static_cast<float>(col) + 0.5F + std::clamp(output.dx, -1.0F, 1.0F),
                 .y = static_cast<float>(row) + 0.5F + std::clamp(output.dy, -1.0F, 1.0F),
                 .charge = charge,
                 .probability = probability,
                 .variance_x = 1.0F / (a * a),
                 .variance_y = ratio * ratio + 1.0F / (c * c),
                 .covariance_xy = -ratio / a};
  seen.precision = 2.0F / (seen.vortex.variance_x + seen.vortex.variance_y);
  seen.row = row;
  seen.col = col;
  workspace.seen.push(seen);
}

void judge_nodes(const ClassifierPlan& plan, ClassifierWorkspace& workspace) noexcept {
  workspace.seen.clear();
  const int node_cols = plan.cols() - 1;
  const std::size_t n_nodes = workspace.nodes.size();
  for (std::size_t first = 0; first < n_nodes; first += ClassifierWorkspace::kChunk) {
    const auto n = std::min<std::size_t>(ClassifierWorkspace::kChunk, n_nodes - first);
    float* to = workspace.a.data();
    for (std::size_t i = 0; i < n; ++i) {
      const std::int32_t node = workspace.nodes[first + i];
      // The map of codes begins one lenslet before the array, as the node's patch does.
      for (int row = 0; row < kPatch; ++row, to += std::ptrdiff_t{kPatch} * kCode) {
        std::copy_n(&workspace.codes(node / node_cols + row, node % node_cols * kCode),
                    kPatch * kCode, to);
      }
    }
    const float* out =
        apply_layers(plan.network(), ClassifierNetwork::kEncoderEnd, ClassifierNetwork::kHeadEnd,
                     static_cast<int>(n), workspace.a.data(), workspace.b.data());
    for (std::size_t i = 0; i < n; ++i, out += kAnswer) {
      const std::int32_t node = workspace.nodes[first + i];
      std::array<NodeOutput, 2> outputs;
      static_assert(std::size_t{2} * kNodeOutputs <= kAnswer);
      for (std::size_t sign = 0; sign < 2; ++sign) {
        const float* o = out + sign * std::size_t{kNodeOutputs};
        outputs[sign] = {o[0], o[1], o[2], o[3], o[4], o[5]};
        add_if_likely(outputs[sign], sign == 0 ? 1 : -1, node / node_cols, node % node_cols,
                      workspace);
      }
    }
  }
}

float distance_squared(const Vortex& a, const Vortex& b) noexcept {
  const float x = a.x - b.x;
  const float y = a.y - b.y;
  return x * x + y * y;
}

/// The surest views in turn: each is reported unless a surer one is the same vortex.
void report(const ClassifierPlan& plan, const CirculationMap& circulation,
            ClassifierWorkspace& workspace, VortexList& vortices) noexcept {
  FixedList<NodeVortex>& seen = workspace.seen;
  if (seen.empty()) return;
  std::sort(&seen[0], &seen[0] + seen.size(), [](const NodeVortex& a, const NodeVortex& b) {
    if (a.vortex.probability != b.vortex.probability)
      return a.vortex.probability > b.vortex.probability;
    return a.row != b.row ? a.row < b.row : a.col < b.col;
  });
  const int node_rows = plan.rows() - 1;
  const auto index_at = [&](int charge, int row, int col) -> std::int32_t& {
    return workspace.seen_at(charge > 0 ? row : row + node_rows, col);
  };
  workspace.seen_at.fill(-1);
  for (std::size_t i = 0; i < seen.size(); ++i)
    index_at(seen[i].vortex.charge, seen[i].row, seen[i].col) = static_cast<std::int32_t>(i);
  const auto for_each_near = [&](const NodeVortex& view, auto&& use) {
    for (int r = std::max(view.row - kNear, 0); r <= std::min(view.row + kNear, node_rows - 1); ++r)
      for (int c = std::max(view.col - kNear, 0); c <= std::min(view.col + kNear, plan.cols() - 2);
           ++c) {
        const std::int32_t i = index_at(view.vortex.charge, r, c);
        if (i >= 0) use(seen[static_cast<std::size_t>(i)]);
      }
  };
  for (NodeVortex& view : seen) {
    if (static_cast<double>(view.vortex.probability) < plan.options().min_probability) break;
    bool first = true;
    float weights = 0.0F, x = 0.0F, y = 0.0F;
    for_each_near(view, [&](const NodeVortex& other) {
      const float apart = distance_squared(view.vortex, other.vortex);
      first &= !(other.precision < 0.0F && apart < kSameVortex * kSameVortex);
      if (apart > kAgree * kAgree) return;
      const float weight = other.vortex.probability * std::abs(other.precision);
      weights += weight;
      x += weight * other.vortex.x;
      y += weight * other.vortex.y;
    });
    if (!first) continue;
    Vortex vortex = view.vortex;
    vortex.x = std::clamp(x / weights, 0.0F, static_cast<float>(plan.cols() - 1));
    vortex.y = std::clamp(y / weights, 0.0F, static_cast<float>(plan.rows() - 1));
    vortex.circulation = circulation.value(view.row, view.col);
    vortex.significance =
        significance(vortex.circulation, circulation.variance(view.row, view.col));
    vortices.push(vortex);
    view.precision = -view.precision;  // reported
  }
}

}  // namespace

void describe_node(const ClassifierWorkspace& workspace, const CirculationMap& circulation, int row,
                   int col, float* to) noexcept {
  const float d = circulation.value(row, col);
  const float sign = d < 0.0F ? -1.0F : 1.0F;
  *to++ = std::min(std::abs(d), kMostCirculation);
  for (int r = row - 1; r <= row + 1; ++r) {
    for (int c = col - 1; c <= col + 1; ++c) {
      if (r == row && c == col) continue;
      const bool inside = circulation.value.contains(r, c);
      *to++ = inside
                  ? std::clamp(sign * circulation.value(r, c), -kMostCirculation, kMostCirculation)
                  : 0.0F;
    }
  }
  for (const Image<float>* map : {&workspace.brightness, &workspace.spread}) {
    *to++ = (*map)(row, col);
    *to++ = (*map)(row, col + 1);
    *to++ = (*map)(row + 1, col);
    *to++ = (*map)(row + 1, col + 1);
  }
  *to++ = std::min(std::sqrt(std::max(circulation.variance(row, col), 0.0F)), kMostCirculation);
  *to++ = 1.0F;
}

ClassifierPlan::ClassifierPlan(const ClassifierOptions& options, const SpotCamera& camera,
                               const FrameFormat& format, ClassifierNetwork network)
    : options_(checked(options, camera)),
      features_(camera, format),
      network_(std::move(network)),
      pixels_per_lambda_w_(static_cast<float>(camera.pixels_per_lambda_w)) {
  AlignedVector<float> a(kSpotFeatures + 64, 0.0F);
  AlignedVector<float> b(a.size());
  const float* code =
      apply_layers(network_, 0, ClassifierNetwork::kEncoderEnd, 1, a.data(), b.data());
  missing_code_.assign(code, code + kCode);
}

ClassifierWorkspace::ClassifierWorkspace(const ClassifierPlan& plan)
    : brightness(plan.rows(), plan.cols()),
      spread(plan.rows(), plan.cols()),
      interest(static_cast<std::size_t>(plan.cols())),
      codes(plan.rows() + 2, (plan.cols() + 2) * kCode),
      wanted(plan.rows(), plan.cols()),
      nodes(wanted.size()),
      lenslets(wanted.size()),
      a(static_cast<std::size_t>(kChunk) * ClassifierNetwork::kWidest),
      b(a.size()),
      seen(2 * wanted.size()),
      seen_at(2 * (plan.rows() - 1), plan.cols() - 1) {
  for (std::size_t i = 0; i < codes.size(); ++i) codes[i] = plan.missing_code()[i % kCode];
}

void classify_vortices(const ClassifierPlan& plan, FrameView frame, const Centroids& centroids,
                       const CirculationMap& circulation, ClassifierWorkspace& workspace,
                       VortexList& vortices) noexcept {
  assert(centroids.state.rows() == plan.rows() && centroids.state.cols() == plan.cols());
  assert(circulation.value.rows() == plan.rows() - 1);
  vortices.clear();
  const float mean = mean_flux(centroids);
  choose_nodes(plan, centroids, circulation, mean, workspace);
  encode_lenslets(plan, frame, centroids, mean, workspace);
  judge_nodes(plan, workspace);
  report(plan, circulation, workspace, vortices);
}

}  // namespace curlew
