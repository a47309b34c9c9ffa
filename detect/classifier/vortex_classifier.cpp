#include "detect/classifier/vortex_classifier.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <span>
#include <string>
#include <utility>

#include "core/as_size.h"
#include "core/error.h"
#include "core/size_check.h"

namespace curlew {
namespace {

constexpr std::size_t kAnswer = kFirstPairOutput + kPairOutputs;
static_assert(kAnswer == ClassifierNetwork::kOutputs[ClassifierNetwork::kJudge.end - 1]);
static_assert(kAnswer == ClassifierNetwork::kOutputs[ClassifierNetwork::kReviewer.end - 1]);
constexpr float kMinLogit = -4.0F;  // A view with a lower logit is dropped.
constexpr int kWord = 8;            // bytes of `wanted` that are tested together

const ClassifierOptions& checked(const ClassifierOptions& options, const SpotCamera& camera) {
  if (!(options.min_probability > 0.0 && options.min_probability < 1.0)) {
    throw UsageError("the least probability is " + std::to_string(options.min_probability) +
                     "; give a number between 0 and 1, such as 0.5");
  }
  if (std::isnan(options.min_scout) || std::isnan(options.min_screen) ||
      std::isnan(options.min_review))
    throw UsageError("what scout, screen and review ask for at least is not a number; give logits");
  if (camera.windows.rows() < 2 || camera.windows.cols() < 2) {
    throw Failure("the sensor has " + std::to_string(camera.windows.rows()) + "x" +
                  std::to_string(camera.windows.cols()) +
                  " lenslets, but a vortex shows between four; use one of 2x2 or more");
  }
  return options;
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
                      workspace.judged.coding->excess_spread, workspace.scout);
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

/// Returns the lenslets of all nodes' patches, of `size` lenslets a side, unless they were listed
/// before.
std::span<const std::int32_t> gather_lenslets(const ClassifierPlan& plan,
                                              const FixedList<std::int32_t>& nodes, int size,
                                              ClassifierWorkspace& workspace) noexcept {
  Image<std::uint8_t>& wanted = workspace.wanted;
  const int node_cols = plan.cols() - 1;
  const int inset = (kPatch - size) / 2;
  for (const std::int32_t node : nodes) {
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
  return {workspace.lenslets.begin(), workspace.lenslets.size()};
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

/// Returns up to kJudgeChunk items of a list, from index `first` on.
std::span<const std::int32_t> chunk_of(const FixedList<std::int32_t>& list,
                                       std::size_t first) noexcept {
  return {list.begin() + first, std::min<std::size_t>(kJudgeChunk, list.size() - first)};
}

/// Keeps only the nodes to which the screen, from their inner lenslets, gives at least min_screen.
void screen_nodes(const ClassifierPlan& plan, ClassifierWorkspace& workspace) noexcept {
  constexpr int kInset = (kPatch - kScreenPatch) / 2;
  constexpr int kScreen = ClassifierNetwork::kScreen;
  constexpr int kCode = ClassifierNetwork::kJudge.code;
  constexpr std::size_t kAnswers = ClassifierNetwork::kOutputs[kScreen + 1];
  FixedList<std::int32_t>& nodes = workspace.nodes;
  const Image<std::int16_t>& codes = workspace.judged.rounded;
  const auto minimum = static_cast<float>(plan.options().min_screen);
  std::array<std::int32_t, kJudgeChunk> starts;
  std::size_t kept = 0;
  for (std::size_t first = 0; first < nodes.size(); first += starts.size()) {
    const auto chunk = chunk_of(nodes, first);
    const auto n = static_cast<int>(chunk.size());
    find_patches(chunk, plan.cols() - 1, kCode, codes.cols(), starts.data());
    multiply_patches(plan.screening(), &codes(kInset, kInset * kCode), codes.cols(), starts.data(),
                     n, workspace.buffers.a.data());
    const float* logits = apply_layers(plan.network(), kScreen + 1, kScreen + 2, n,
                                       workspace.buffers.a.data(), workspace.buffers.b.data());
    for (std::size_t i = 0; i < chunk.size(); ++i) {
      nodes[kept] = chunk[i];
      kept += logits[i * kAnswers] >= minimum ? 1 : 0;
    }
  }
  nodes.shorten(kept);
}

/// Judges all nodes, and lists those that are to be reviewed.
void judge_nodes(const ClassifierPlan& plan, ClassifierWorkspace& workspace) noexcept {
  const FixedList<std::int32_t>& nodes = workspace.nodes;
  const auto minimum = static_cast<float>(plan.options().min_review);
  workspace.to_review.clear();
  workspace.places.clear();
  for (std::size_t first = 0; first < nodes.size(); first += kJudgeChunk) {
    const auto chunk = chunk_of(nodes, first);
    const float* from = judge_patches(plan.network(), plan.judge(), workspace.judged, chunk,
                                      plan.cols() - 1, workspace.buffers);
    float* to = workspace.answers.data() + first * kAnswer;
    std::copy_n(from, chunk.size() * kAnswer, to);
    for (std::size_t i = 0; i < chunk.size(); ++i, to += kAnswer) {
      if (!(std::max({to[0], to[kNodeOutputs], to[kFirstPairOutput]}) > minimum)) continue;
      workspace.to_review.push(chunk[i]);
      workspace.places.push(static_cast<std::int32_t>(first + i));
    }
  }
}

/// Replaces the judge's answers for the nodes in question by the mean of these and the reviewer's.
void review_nodes(const ClassifierPlan& plan, ClassifierWorkspace& workspace) noexcept {
  const FixedList<std::int32_t>& nodes = workspace.to_review;
  for (std::size_t first = 0; first < nodes.size(); first += kJudgeChunk) {
    const auto chunk = chunk_of(nodes, first);
    const float* from = judge_patches(plan.network(), plan.reviewer(), workspace.reviewed, chunk,
                                      plan.cols() - 1, workspace.buffers);
    for (std::size_t i = first; i < first + chunk.size(); ++i) {
      float* const answer = workspace.answers.data() + as_size(workspace.places[i]) * kAnswer;
      for (std::size_t k = 0; k < kAnswer; ++k) answer[k] = 0.5F * (answer[k] + *from++);
    }
  }
}

/// Turns the answers for all nodes into views.
void view_nodes(const ClassifierPlan& plan, ClassifierWorkspace& workspace) noexcept {
  workspace.views.seen.clear();
  const int node_cols = plan.cols() - 1;
  const float* answer = workspace.answers.data();
  const float* exponential = workspace.exponentials.data();
  take_exponentials(answer, static_cast<int>(workspace.nodes.size() * kAnswer),
                    workspace.exponentials.data());
  for (const std::int32_t node : workspace.nodes) {
    const int row = node / node_cols;
    const int col = node % node_cols;
    const auto see = [&](const Vortex& vortex) {
      if (!workspace.lit.is_seen(vortex)) return;
      workspace.views.seen.push({vortex, 2.0F / (vortex.variance_x + vortex.variance_y), row, col});
    };
    const auto read = [](auto output, const float* numbers) {
      std::memcpy(&output, numbers, sizeof output);
      return output;
    };
    for (const int charge : {1, -1}) {
      const std::size_t first = charge > 0 ? 0 : kNodeOutputs;
      const auto output = read(NodeOutput{}, answer + first);
      if (output.logit >= kMinLogit)
        see(vortex_of(output, read(NodeOutput{}, exponential + first), charge, row, col));
    }
    const auto output = read(PairOutput{}, answer + kFirstPairOutput);
    if (output.logit >= kMinLogit)
      see(vortex_of(output, read(PairOutput{}, exponential + kFirstPairOutput), row, col));
    answer += kAnswer;
    exponential += kAnswer;
  }
}

}  // namespace

ClassifierPlan::ClassifierPlan(const ClassifierOptions& options, const SpotCamera& camera,
                               const FrameFormat& format, ClassifierNetwork network)
    : options_(checked(options, camera)),
      features_(camera, format),
      network_(std::move(network)),
      judge_(network_, ClassifierNetwork::kJudge, camera, options.as_trained),
      reviewer_(network_, ClassifierNetwork::kReviewer, camera, options.as_trained),
      screening_(network_.layers[ClassifierNetwork::kScreen], kScreenPatch),
      pixels_per_lambda_w_(static_cast<float>(camera.pixels_per_lambda_w)) {
  // The first input of the scout's first layer is 1, so that its bias can be added to that input's
  // weights.
  DenseLayer& scouting = network_.layers[ClassifierNetwork::kScout];
  for (std::size_t i = 0; i < scouting.bias.size(); ++i)
    scouting.weights[i] += std::exchange(scouting.bias[i], 0.0F);
}

ClassifierWorkspace::ClassifierWorkspace(const ClassifierPlan& plan)
    : scout(plan.rows(), plan.cols()),
      judged(plan.judge(), plan.rows(), plan.cols()),
      reviewed(plan.reviewer(), plan.rows(), plan.cols()),
      measured(plan.features().lenslet_count()),
      wanted(plan.rows() + 2, (plan.cols() + 2 + kWord - 1) / kWord * kWord),
      lenslets(wanted.size()),
      nodes(as_size(plan.rows() - 1) * as_size(plan.cols() - 1)),
      to_review(nodes.capacity()),
      places(nodes.capacity()),
      answers(nodes.capacity() * kAnswer),
      exponentials(answers.size()),
      views(plan.rows() - 1, plan.cols() - 1),
      lit(plan.rows(), plan.cols()) {}

void find_classified_vortices(const ClassifierPlan& plan, FrameView frame, const FrameShift& shift,
                              const Centroids& centroids, const CirculationMap& circulation,
                              ClassifierWorkspace& workspace, VortexList& vortices) noexcept {
  check_size("find_classified_vortices", "centroids", size_of(centroids.state), size_of(plan));
  check_size("find_classified_vortices", "circulation", size_of(circulation.value),
             {plan.rows() - 1, plan.cols() - 1});
  vortices.clear();
  workspace.measured.count = 0;
  workspace.nodes.clear();
  workspace.to_review.clear();
  const FrameSpots spots{plan.features(), frame, shift, centroids, mean_flux(centroids)};
  const float mean = spots.mean_flux_adu;
  const double core = typical_core_variance(plan.features(), frame, shift, centroids, mean,
                                            workspace.buffers.a.data());
  const double blur = plan.judge().codings.blur_of(core);
  workspace.judged.coding = plan.judge().codings.find(blur);
  workspace.reviewed.coding = plan.reviewer().codings.find(blur);
  if (workspace.judged.coding == nullptr) return;
  workspace.lit.look_at(centroids, mean);
  choose_nodes(plan, centroids, circulation, mean, workspace);
  workspace.wanted.fill(0);
  const auto encode = [&](int size) {
    measure_and_encode(plan.network(), plan.judge(), spots,
                       gather_lenslets(plan, workspace.nodes, size, workspace), workspace.measured,
                       workspace.buffers, workspace.judged);
  };
  if (plan.screens()) {
    encode(kScreenPatch);
    screen_nodes(plan, workspace);
  }
  encode(kPatch);
  judge_nodes(plan, workspace);
  if (!workspace.to_review.empty()) {
    workspace.wanted.fill(0);
    encode_measured(plan.network(), plan.reviewer(), spots,
                    gather_lenslets(plan, workspace.to_review, kPatch, workspace),
                    workspace.measured, workspace.buffers, workspace.reviewed);
    review_nodes(plan, workspace);
  }
  view_nodes(plan, workspace);
  report_vortices(circulation, plan.options().min_probability, workspace.views, vortices);
}

}  // namespace curlew
