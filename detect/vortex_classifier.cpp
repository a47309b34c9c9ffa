#include "detect/vortex_classifier.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <cstring>
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
static_assert(kFirstPairOutput + kPairOutputs == kAnswer);
constexpr float kLeastLogit = -4.0F;    // seen from one node: below this it is nothing
constexpr float kBelievedPair = 0.5F;   // less likely pairs are not reported
constexpr float kSameVortex = 0.8F;     // pitches: vortices of one sign nearer are one
constexpr float kPairOrVortex = 0.75F;  // pitches: a vortex and a pair nearer are one or the other
constexpr float kAgree = 0.8F;          // pitches: nodes that see it here have a say in where
constexpr int kNear = 2;                // nodes along an axis, between views of one vortex
constexpr int kWord = 8;                // bytes of `wanted` that are looked at together

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

/// Nodes whose four lenslets are there, but for one at most, and which the scout thinks worth it.
void choose_nodes(const ClassifierPlan& plan, const Centroids& centroids,
                  const CirculationMap& circulation, float mean,
                  ClassifierWorkspace& workspace) noexcept {
  FixedList<std::int32_t>& nodes = workspace.nodes;
  nodes.clear();
  const int node_rows = plan.rows() - 1;
  const int node_cols = plan.cols() - 1;
  const double least = plan.options().min_scout;
  const bool all = least <= kEveryNode;
  if (!all) {
    describe_lenslets(centroids, circulation, mean, plan.pixels_per_lambda_w(), workspace.scout);
    scout_nodes(plan.network(), workspace.scout);
  }
  const auto least_logit = all ? 0.0F : static_cast<float>(least);
  for (int row = 0; row < node_rows; ++row) {
    const float* logits = &workspace.scout.logits(row, 0);
    for (int col = 0; col < node_cols; ++col) {
      if (!(all | (logits[col] >= least_logit))) continue;
      int missing = 0;
      for (int i = row; i <= row + 1; ++i)
        for (int j = col; j <= col + 1; ++j) missing += is_missing(centroids.state(i, j)) ? 1 : 0;
      if (missing <= 1) nodes.push(row * node_cols + col);
    }
  }
}

/// Lists the lenslets of all patches.
void gather_lenslets(const ClassifierPlan& plan, ClassifierWorkspace& workspace) noexcept {
  Image<std::uint8_t>& wanted = workspace.wanted;
  const int node_cols = plan.cols() - 1;
  wanted.fill(0);
  for (const std::int32_t node : workspace.nodes)
    for (int i = 0; i < kPatch; ++i)
      std::fill_n(&wanted(node / node_cols + i, node % node_cols), kPatch, std::uint8_t{1});
  workspace.lenslets.clear();
  for (int row = 0; row < plan.rows(); ++row) {
    const std::uint8_t* of_row = &wanted(row + 1, 0);
    for (int first = 0; first < wanted.cols(); first += kWord) {
      std::uint64_t word = 0;
      std::memcpy(&word, of_row + first, kWord);
      if (word == 0) continue;
      for (int i = 0; i < kWord; ++i) {
        const int col = first + i - 1;
        if (of_row[first + i] != 0 && col >= 0 && col < plan.cols())
          workspace.lenslets.push(row * plan.cols() + col);
      }
    }
  }
}

void encode_lenslets(const ClassifierPlan& plan, FrameView frame, const Centroids& centroids,
                     float mean, ClassifierWorkspace& workspace) noexcept {
  const int cols = plan.cols();
  struct Waiting {
    std::size_t lenslet;
    float* code;
  };
  std::array<Waiting, ClassifierWorkspace::kChunk> chunk;
  std::array<SpotProjection, ClassifierWorkspace::kChunk> projections;
  int n = 0;
  const auto flush = [&] {
    for (int i = 0; i < n; ++i) {
      const std::size_t k = chunk[static_cast<std::size_t>(i)].lenslet;
      plan.features().describe(k, projections[static_cast<std::size_t>(i)], centroids.flux_adu[k],
                               mean, workspace.a.data() + std::ptrdiff_t{i} * kSpotFeatures);
    }
    const float* codes = apply_layers(plan.network(), 0, ClassifierNetwork::kEncoderEnd, n,
                                      workspace.a.data(), workspace.b.data());
    for (int i = 0; i < n; ++i)
      std::copy_n(codes + std::ptrdiff_t{i} * kCode, kCode,
                  chunk[static_cast<std::size_t>(i)].code);
    n = 0;
  };
  for (const std::int32_t k : workspace.lenslets) {
    const auto u = static_cast<std::size_t>(k);
    float* const code = &workspace.codes(k / cols + 1, (k % cols + 1) * kCode);
    if (is_missing(centroids.state[u]) || !plan.features().has_lenslet(u)) {
      std::copy_n(plan.missing_code(), kCode, code);
      continue;
    }
    plan.features().project(frame, u, projections[static_cast<std::size_t>(n)]);
    chunk[static_cast<std::size_t>(n++)] = {u, code};
    if (n == ClassifierWorkspace::kChunk) flush();
  }
  if (n > 0) flush();
}

float probability_of(float logit) noexcept { return 1.0F / (1.0F + std::exp(-logit)); }

Vortex vortex_at(int row, int col, float dx, float dy) noexcept {
  Vortex vortex;
  vortex.x = static_cast<float>(col) + 0.5F + std::clamp(dx, -1.0F, 1.0F);
  vortex.y = static_cast<float>(row) + 0.5F + std::clamp(dy, -1.0F, 1.0F);
  return vortex;
}

float scale_of(float log_scale) noexcept {
  return std::exp(std::clamp(log_scale, kLeastLogScale, kMostLogScale));
}

Vortex vortex_of(const NodeOutput& output, int charge, int row, int col) noexcept {
  const float a = scale_of(output.log_a);
  const float c = scale_of(output.log_c);
  const float ratio = output.b / (a * c);
  Vortex vortex = vortex_at(row, col, output.dx, output.dy);
  vortex.charge = charge;
  vortex.probability = probability_of(output.logit);
  vortex.variance_x = 1.0F / (a * a);
  vortex.variance_y = ratio * ratio + 1.0F / (c * c);
  vortex.covariance_xy = -ratio / a;
  return vortex;
}

Vortex vortex_of(const PairOutput& output, int row, int col) noexcept {
  const float scale = scale_of(output.log_scale);
  Vortex vortex = vortex_at(row, col, output.dx, output.dy);
  vortex.flags = kVortexUnresolvedPair;
  vortex.probability = probability_of(output.logit);
  vortex.variance_x = vortex.variance_y = 1.0F / (scale * scale);
  return vortex;
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
      const int row = node / node_cols;
      const int col = node % node_cols;
      const auto see = [&](const Vortex& vortex) {
        workspace.seen.push({vortex, 2.0F / (vortex.variance_x + vortex.variance_y), row, col});
      };
      for (const int charge : {1, -1}) {
        const float* o = out + (charge > 0 ? 0 : kNodeOutputs);
        if (o[0] >= kLeastLogit)
          see(vortex_of(NodeOutput{o[0], o[1], o[2], o[3], o[4], o[5]}, charge, row, col));
      }
      const float* o = out + kFirstPairOutput;
      if (o[0] >= kLeastLogit) see(vortex_of(PairOutput{o[0], o[1], o[2], o[3]}, row, col));
    }
  }
}

float distance_squared(const Vortex& a, const Vortex& b) noexcept {
  const float x = a.x - b.x;
  const float y = a.y - b.y;
  return x * x + y * y;
}

/// The surest views in turn: each is reported unless a surer one is the same vortex, or was a pair
/// where this is a vortex, or the other way about.
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
    return workspace.seen_at((charge + 1) * node_rows + row, col);
  };
  workspace.seen_at.fill(-1);
  for (std::size_t i = 0; i < seen.size(); ++i)
    index_at(seen[i].vortex.charge, seen[i].row, seen[i].col) = static_cast<std::int32_t>(i);
  const auto for_each_near = [&](const NodeVortex& view, int charge, auto&& use) {
    const int last_row = std::min(view.row + kNear, node_rows - 1);
    const int last_col = std::min(view.col + kNear, plan.cols() - 2);
    for (int r = std::max(view.row - kNear, 0); r <= last_row; ++r) {
      for (int c = std::max(view.col - kNear, 0); c <= last_col; ++c) {
        const std::int32_t i = index_at(charge, r, c);
        if (i >= 0) use(seen[static_cast<std::size_t>(i)]);
      }
    }
  };
  for (NodeVortex& view : seen) {
    if (static_cast<double>(view.vortex.probability) < plan.options().min_probability) break;
    const int charge = view.vortex.charge;
    if (charge == 0 && view.vortex.probability < kBelievedPair) continue;
    bool first = true;
    float weights = 0.0F, x = 0.0F, y = 0.0F;
    for_each_near(view, charge, [&](const NodeVortex& other) {
      const float apart = distance_squared(view.vortex, other.vortex);
      first &= !(other.precision < 0.0F && apart < kSameVortex * kSameVortex);
      if (apart > kAgree * kAgree) return;
      const float weight = other.vortex.probability * std::abs(other.precision);
      weights += weight;
      x += weight * other.vortex.x;
      y += weight * other.vortex.y;
    });
    const auto give_way = [&](const NodeVortex& other) {
      const float apart = distance_squared(view.vortex, other.vortex);
      first &= !(other.precision < 0.0F && apart < kPairOrVortex * kPairOrVortex);
    };
    if (charge != 0) {
      for_each_near(view, 0, give_way);
    } else {
      for_each_near(view, 1, give_way);
      for_each_near(view, -1, give_way);
    }
    if (!first) continue;
    Vortex vortex = view.vortex;
    vortex.x = std::clamp(x / weights, 0.0F, static_cast<float>(plan.cols() - 1));
    vortex.y = std::clamp(y / weights, 0.0F, static_cast<float>(plan.rows() - 1));
    for_each_near(view, charge, [&](const NodeVortex& other) {
      first &= !(other.precision < 0.0F &&
                 distance_squared(vortex, other.vortex) < kSameVortex * kSameVortex);
    });
    if (!first) continue;
    vortex.circulation = circulation.value(view.row, view.col);
    vortex.significance =
        significance(vortex.circulation, circulation.variance(view.row, view.col));
    vortices.push(vortex);
    view.vortex = vortex;
    view.precision = -view.precision;  // reported
  }
}

}  // namespace

ClassifierPlan::ClassifierPlan(const ClassifierOptions& options, const SpotCamera& camera,
                               const FrameFormat& format, ClassifierNetwork network)
    : options_(checked(options, camera)),
      features_(camera, format),
      network_(std::move(network)),
      pixels_per_lambda_w_(static_cast<float>(camera.pixels_per_lambda_w)) {
  DenseLayer& scouting = network_.layers[ClassifierNetwork::kHeadEnd];  // its first input is 1
  for (std::size_t i = 0; i < scouting.bias.size(); ++i)
    scouting.weights[i] += std::exchange(scouting.bias[i], 0.0F);
  AlignedVector<float> a(kSpotFeatures + 64, 0.0F);
  AlignedVector<float> b(a.size());
  const float* code =
      apply_layers(network_, 0, ClassifierNetwork::kEncoderEnd, 1, a.data(), b.data());
  missing_code_.assign(code, code + kCode);
}

ClassifierWorkspace::ClassifierWorkspace(const ClassifierPlan& plan)
    : scout(plan.rows(), plan.cols()),
      codes(plan.rows() + 2, (plan.cols() + 2) * kCode),
      wanted(plan.rows() + 2, (plan.cols() + 2 + kWord - 1) / kWord * kWord),
      nodes(wanted.size()),
      lenslets(wanted.size()),
      a(static_cast<std::size_t>(kChunk) * ClassifierNetwork::kWidest),
      b(a.size()),
      seen(3 * wanted.size()),
      seen_at(3 * (plan.rows() - 1), plan.cols() - 1) {
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
  gather_lenslets(plan, workspace);
  encode_lenslets(plan, frame, centroids, mean, workspace);
  judge_nodes(plan, workspace);
  report(plan, circulation, workspace, vortices);
}

}  // namespace curlew
