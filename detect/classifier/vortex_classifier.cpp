#include "detect/classifier/vortex_classifier.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <string>
#include <utility>

#include "core/error.h"
#include "core/size_check.h"
#include "detect/classifier/matrix_product.h"

namespace curlew {
namespace {

constexpr int kCode = ClassifierNetwork::kCode;
constexpr std::size_t kAnswer = ClassifierNetwork::kOutputs[ClassifierNetwork::kHeadEnd - 1];
static_assert(kFirstPairOutput + kPairOutputs == kAnswer);
constexpr float kMinLogit = -4.0F;  // A view with a lower logit is dropped.
constexpr int kWord = 8;            // bytes of `wanted` that are tested together

const ClassifierOptions& checked(const ClassifierOptions& options, const SpotCamera& camera) {
  if (!(options.min_probability > 0.0 && options.min_probability < 1.0)) {
    throw UsageError("the least probability is " + std::to_string(options.min_probability) +
                     "; give a number between 0 and 1, such as 0.5");
  }
  if (std::isnan(options.min_scout) || std::isnan(options.min_screen))
    throw UsageError("what scout and screen ask for at least is not a number; give logits");
  if (camera.windows.rows() < 2 || camera.windows.cols() < 2) {
    throw Failure("the sensor has " + std::to_string(camera.windows.rows()) + "x" +
                  std::to_string(camera.windows.cols()) +
                  " lenslets, but a vortex shows between four; use one of 2x2 or more");
  }
  return options;
}

/// Applies layers [first, last) to n samples in `in`. Returns the buffer that holds the result;
/// both buffers are used.
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

/// Applies the encoder to the features of n spots in `in`, as apply_layers() does.
const float* encode(const ClassifierNetwork& network, const DenseLayer& first, int n, float* in,
                    float* out) noexcept {
  multiply({in, first.inputs, 1}, first.weights.data(), first.bias.data(), n, first.inputs,
           first.outputs, ClassifierNetwork::rectified(0), out);
  return apply_layers(network, 1, ClassifierNetwork::kEncoderEnd, n, out, in);
}

/// Chooses the nodes that are seen and to which the scout gives at least min_scout.
void choose_nodes(const ClassifierPlan& plan, const Centroids& centroids,
                  const CirculationMap& circulation, float mean,
                  ClassifierWorkspace& workspace) noexcept {
  FixedList<std::int32_t>& nodes = workspace.nodes;
  nodes.clear();
  const int node_rows = plan.rows() - 1;
  const int node_cols = plan.cols() - 1;
  const double minimum = plan.options().min_scout;
  const bool all = minimum <= kEveryNode;
  if (!all) {
    describe_lenslets(centroids, circulation, mean, plan.pixels_per_lambda_w(),
                      workspace.coding->excess_spread, workspace.scout);
    scout_nodes(plan.network(), workspace.scout);
  }
  const auto min_logit = all ? 0.0F : static_cast<float>(minimum);
  for (int row = 0; row < node_rows; ++row) {
    const float* logits = &workspace.scout.logits(row, 0);
    for (int col = 0; col < node_cols; ++col) {
      if ((all | (logits[col] >= min_logit)) && workspace.lit.is_seen(row, col))
        nodes.push(row * node_cols + col);
    }
  }
}

/// Returns the place in memory of the byte with the lowest set bit, where there is one bit a byte.
int byte_of_lowest_bit(std::uint64_t word) noexcept {
  static_assert(std::endian::native == std::endian::little);
  return std::countr_zero(word) / 8;
}

/// Lists the lenslets of all nodes' patches, of `size` lenslets a side, unless they were listed
/// before.
void gather_lenslets(const ClassifierPlan& plan, int size,
                     ClassifierWorkspace& workspace) noexcept {
  Image<std::uint8_t>& wanted = workspace.wanted;
  const int node_cols = plan.cols() - 1;
  const int inset = (kPatch - size) / 2;
  for (const std::int32_t node : workspace.nodes) {
    std::uint8_t* row = &wanted(node / node_cols + inset, node % node_cols + inset);
    for (int i = 0; i < size; ++i, row += wanted.cols())
      for (int j = 0; j < size; ++j) row[j] = static_cast<std::uint8_t>(row[j] | 1U);
  }
  workspace.lenslets.clear();
  for (int row = 0; row < plan.rows(); ++row) {
    std::uint8_t* of_row = &wanted(row + 1, 0);
    for (int first = 0; first < wanted.cols(); first += kWord) {
      std::uint64_t word = 0;
      std::memcpy(&word, of_row + first, kWord);
      std::uint64_t unlisted = word & ~(word >> 1U) & 0x0101010101010101U;
      if (unlisted == 0) continue;
      word |= unlisted << 1U;
      std::memcpy(of_row + first, &word, kWord);
      for (; unlisted != 0; unlisted &= unlisted - 1) {
        const int col = first + byte_of_lowest_bit(unlisted) - 1;
        if (col >= 0 && col < plan.cols()) workspace.lenslets.push(row * plan.cols() + col);
      }
    }
  }
}

void encode_lenslets(const ClassifierPlan& plan, FrameView frame, const FrameShift& shift,
                     const Centroids& centroids, float mean,
                     ClassifierWorkspace& workspace) noexcept {
  const int cols = plan.cols();
  workspace.encoded += static_cast<int>(workspace.lenslets.size());
  std::array<std::int32_t, ClassifierWorkspace::kChunk> chunk;
  std::array<std::ptrdiff_t, ClassifierWorkspace::kChunk> to;
  int n = 0;
  const bool as_trained = plan.options().as_trained;
  std::array<std::int16_t, std::size_t{ClassifierWorkspace::kChunk} * kCode> rounded;
  const auto keep = [&](const float* codes) {
    round_codes(codes, n * kCode, rounded.data());
    for (std::ptrdiff_t i = 0; i < n; ++i) {
      const std::ptrdiff_t at = to[static_cast<std::size_t>(i)];
      std::copy_n(rounded.data() + i * kCode, kCode, workspace.codes.data() + at);
      if (as_trained) std::copy_n(codes + i * kCode, kCode, workspace.exact_codes.data() + at);
    }
    n = 0;
  };
  const auto flush = [&] {
    if (as_trained) {
      for (int i = 0; i < n; ++i) {
        const auto k = static_cast<std::size_t>(chunk[static_cast<std::size_t>(i)]);
        plan.features().measure(frame, shift, k, centroids.flux_adu[k], mean,
                                workspace.a.data() + std::ptrdiff_t{i} * kSpotFeatures);
      }
    } else {
      plan.features().measure_many(frame, shift, chunk.data(), n, centroids.flux_adu.data(), mean,
                                   workspace.a.data());
    }
    const float* codes =
        encode(plan.network(), workspace.coding->layer, n, workspace.a.data(), workspace.b.data());
    keep(codes);
  };
  for (const std::int32_t k : workspace.lenslets) {
    const auto u = static_cast<std::size_t>(k);
    const std::ptrdiff_t at = (std::ptrdiff_t{k / cols + 1} * (cols + 2) + k % cols + 1) * kCode;
    if (is_missing(centroids.state[u]) || !plan.features().has_lenslet(u)) {
      std::copy_n(plan.missing_rounded(), kCode, workspace.codes.data() + at);
      if (as_trained) std::copy_n(plan.missing_code(), kCode, workspace.exact_codes.data() + at);
      continue;
    }
    to[static_cast<std::size_t>(n)] = at;
    chunk[static_cast<std::size_t>(n++)] = k;
    if (n == ClassifierWorkspace::kChunk) flush();
  }
  if (n > 0) flush();
}

Vortex vortex_at(int row, int col, float dx, float dy) noexcept {
  Vortex vortex;
  vortex.x = static_cast<float>(col) + 0.5F + std::clamp(dx, -1.0F, 1.0F);
  vortex.y = static_cast<float>(row) + 0.5F + std::clamp(dy, -1.0F, 1.0F);
  return vortex;
}

float probability_of(float odds) noexcept { return odds / (1.0F + odds); }

const float kMinScale = std::exp(kMinLogScale);
const float kMaxScale = std::exp(kMaxLogScale);

float scale_of(float exponential) noexcept { return std::clamp(exponential, kMinScale, kMaxScale); }

/// Returns the vortex of a node's output. `exponentials` holds the exponentials of the members of
/// `output`, of which logit, log_a and log_c are used.
Vortex vortex_of(const NodeOutput& output, const NodeOutput& exponentials, int charge, int row,
                 int col) noexcept {
  const float inverse_a = 1.0F / scale_of(exponentials.log_a);
  const float inverse_c = 1.0F / scale_of(exponentials.log_c);
  const float ratio = output.b * inverse_a * inverse_c;
  Vortex vortex = vortex_at(row, col, output.dx, output.dy);
  vortex.charge = charge;
  vortex.probability = probability_of(exponentials.logit);
  vortex.variance_x = inverse_a * inverse_a;
  vortex.variance_y = ratio * ratio + inverse_c * inverse_c;
  vortex.covariance_xy = -ratio * inverse_a;
  return vortex;
}

Vortex vortex_of(const PairOutput& output, const PairOutput& exponentials, int row,
                 int col) noexcept {
  const float scale = scale_of(exponentials.log_scale);
  Vortex vortex = vortex_at(row, col, output.dx, output.dy);
  vortex.flags = kVortexUnresolvedPair;
  vortex.probability = probability_of(exponentials.logit);
  vortex.variance_x = vortex.variance_y = 1.0F / (scale * scale);
  return vortex;
}

/// Finds where the patches of n nodes begin in the map of codes. The map begins one lenslet before
/// the array, as a patch does before its node.
void find_patches(const ClassifierPlan& plan, const std::int32_t* nodes, int n, int row_step,
                  std::int32_t* starts) noexcept {
  const int node_cols = plan.cols() - 1;
  for (int i = 0; i < n; ++i)
    starts[i] = nodes[i] / node_cols * row_step + nodes[i] % node_cols * kCode;
}

/// Keeps only the nodes to which the screen, from their inner lenslets, gives at least min_screen.
void screen_nodes(const ClassifierPlan& plan, ClassifierWorkspace& workspace) noexcept {
  constexpr int kFirst = ClassifierNetwork::kScoutEnd;
  constexpr int kInset = (kPatch - kScreenPatch) / 2;
  constexpr std::size_t kAnswers = ClassifierNetwork::kOutputs.back();
  FixedList<std::int32_t>& nodes = workspace.nodes;
  const int row_step = workspace.codes.cols();
  const auto minimum = static_cast<float>(plan.options().min_screen);
  std::array<std::int32_t, ClassifierWorkspace::kChunk> starts;
  std::size_t kept = 0;
  for (std::size_t first = 0; first < nodes.size(); first += starts.size()) {
    const std::size_t n = std::min(starts.size(), nodes.size() - first);
    const auto count = static_cast<int>(n);
    find_patches(plan, &nodes[first], count, row_step, starts.data());
    multiply_patches(plan.screening(),
                     workspace.codes.data() + std::ptrdiff_t{kInset} * (row_step + kCode), row_step,
                     starts.data(), count, workspace.a.data());
    const float* logits = apply_layers(plan.network(), kFirst + 1, ClassifierNetwork::kLayers,
                                       count, workspace.a.data(), workspace.b.data());
    for (std::size_t i = 0; i < n; ++i) {
      const std::int32_t node = nodes[first + i];
      nodes[kept] = node;
      kept += logits[i * kAnswers] >= minimum ? 1 : 0;
    }
  }
  nodes.shorten(kept);
}

/// Returns the head's answers for n nodes.
const float* judge_patches(const ClassifierPlan& plan, const std::int32_t* nodes, int n,
                           ClassifierWorkspace& workspace) noexcept {
  constexpr int kFirst = ClassifierNetwork::kEncoderEnd;
  const int row_step = workspace.codes.cols();
  std::array<std::int32_t, ClassifierWorkspace::kChunk> starts;
  find_patches(plan, nodes, n, row_step, starts.data());
  if (!plan.options().as_trained) {
    multiply_patches(plan.judging(), workspace.codes.data(), row_step, starts.data(), n,
                     workspace.a.data());
    return apply_layers(plan.network(), kFirst + 1, ClassifierNetwork::kHeadEnd, n,
                        workspace.a.data(), workspace.b.data());
  }
  float* to = workspace.a.data();
  for (int i = 0; i < n; ++i) {
    const float* from = workspace.exact_codes.data() + starts[static_cast<std::size_t>(i)];
    for (int row = 0; row < kPatch; ++row, from += row_step, to += std::ptrdiff_t{kPatch} * kCode)
      std::copy_n(from, kPatch * kCode, to);
  }
  return apply_layers(plan.network(), kFirst, ClassifierNetwork::kHeadEnd, n, workspace.a.data(),
                      workspace.b.data());
}

void judge_nodes(const ClassifierPlan& plan, ClassifierWorkspace& workspace) noexcept {
  workspace.views.seen.clear();
  const int node_cols = plan.cols() - 1;
  const std::size_t n_nodes = workspace.nodes.size();
  for (std::size_t first = 0; first < n_nodes; first += ClassifierWorkspace::kChunk) {
    const auto n = std::min<std::size_t>(ClassifierWorkspace::kChunk, n_nodes - first);
    const float* out = judge_patches(plan, &workspace.nodes[first], static_cast<int>(n), workspace);
    float* const exponentials = workspace.exponentials.data();
    take_exponentials(out, static_cast<int>(n * kAnswer), exponentials);
    for (std::size_t i = 0; i < n; ++i) {
      const std::int32_t node = workspace.nodes[first + i];
      const int row = node / node_cols;
      const int col = node % node_cols;
      const auto see = [&](const Vortex& vortex) {
        if (!workspace.lit.is_seen(vortex)) return;
        workspace.views.seen.push(
            {vortex, 2.0F / (vortex.variance_x + vortex.variance_y), row, col});
      };
      const auto read = [&](auto output, const float* numbers, std::size_t offset) {
        std::memcpy(&output, numbers + i * kAnswer + offset, sizeof output);
        return output;
      };
      for (const int charge : {1, -1}) {
        const std::size_t offset = charge > 0 ? 0 : kNodeOutputs;
        const auto output = read(NodeOutput{}, out, offset);
        if (output.logit >= kMinLogit)
          see(vortex_of(output, read(NodeOutput{}, exponentials, offset), charge, row, col));
      }
      const auto output = read(PairOutput{}, out, kFirstPairOutput);
      if (output.logit >= kMinLogit)
        see(vortex_of(output, read(PairOutput{}, exponentials, kFirstPairOutput), row, col));
    }
  }
}

}  // namespace

ClassifierPlan::ClassifierPlan(const ClassifierOptions& options, const SpotCamera& camera,
                               const FrameFormat& format, ClassifierNetwork network)
    : options_(checked(options, camera)),
      features_(camera, format),
      network_(std::move(network)),
      codings_(network_.layers.front(), camera, options.as_trained),
      judging_(network_.layers[ClassifierNetwork::kEncoderEnd], kPatch),
      screening_(network_.layers[ClassifierNetwork::kScoutEnd], kScreenPatch),
      pixels_per_lambda_w_(static_cast<float>(camera.pixels_per_lambda_w)) {
  // The first input of the scout's first layer is 1, so that its bias can be added to that input's
  // weights.
  DenseLayer& scouting = network_.layers[ClassifierNetwork::kHeadEnd];
  for (std::size_t i = 0; i < scouting.bias.size(); ++i)
    scouting.weights[i] += std::exchange(scouting.bias[i], 0.0F);
  AlignedVector<float> a(kSpotFeatures + 64, 0.0F);
  AlignedVector<float> b(a.size());
  const float* code = encode(network_, codings_.as_calibrated().layer, 1, a.data(), b.data());
  missing_code_.assign(code, code + kCode);
  missing_rounded_.resize(kCode);
  round_codes(code, kCode, missing_rounded_.data());
}

ClassifierWorkspace::ClassifierWorkspace(const ClassifierPlan& plan)
    : scout(plan.rows(), plan.cols()),
      codes(plan.rows() + 2, (plan.cols() + 2) * kCode),
      wanted(plan.rows() + 2, (plan.cols() + 2 + kWord - 1) / kWord * kWord),
      nodes(wanted.size()),
      lenslets(wanted.size()),
      a(static_cast<std::size_t>(kChunk) * ClassifierNetwork::kWidest),
      b(a.size()),
      exponentials(kChunk * kAnswer),
      views(plan.rows() - 1, plan.cols() - 1),
      lit(plan.rows(), plan.cols()) {
  if (plan.options().as_trained) exact_codes = Image<float>(codes.rows(), codes.cols());
  for (std::size_t i = 0; i < codes.size(); i += kCode) {
    std::copy_n(plan.missing_rounded(), kCode, codes.data() + i);
    if (!exact_codes.empty()) std::copy_n(plan.missing_code(), kCode, exact_codes.data() + i);
  }
}

void find_classified_vortices(const ClassifierPlan& plan, FrameView frame, const FrameShift& shift,
                              const Centroids& centroids, const CirculationMap& circulation,
                              ClassifierWorkspace& workspace, VortexList& vortices) noexcept {
  check_size("find_classified_vortices", "centroids", size_of(centroids.state), size_of(plan));
  check_size("find_classified_vortices", "circulation", size_of(circulation.value),
             {plan.rows() - 1, plan.cols() - 1});
  vortices.clear();
  workspace.encoded = 0;
  const float mean = mean_flux(centroids);
  const double core =
      typical_core_variance(plan.features(), frame, shift, centroids, mean, workspace.a.data());
  workspace.coding = plan.codings().find(plan.codings().blur_of(core));
  if (workspace.coding == nullptr) return;
  workspace.lit.look_at(centroids, mean);
  choose_nodes(plan, centroids, circulation, mean, workspace);
  workspace.wanted.fill(0);
  if (plan.screens()) {
    gather_lenslets(plan, kScreenPatch, workspace);
    encode_lenslets(plan, frame, shift, centroids, mean, workspace);
    screen_nodes(plan, workspace);
  }
  gather_lenslets(plan, kPatch, workspace);
  encode_lenslets(plan, frame, shift, centroids, mean, workspace);
  judge_nodes(plan, workspace);
  report_vortices(circulation, plan.options().min_probability, workspace.views, vortices);
}

}  // namespace curlew
