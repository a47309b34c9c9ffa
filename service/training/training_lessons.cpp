#include "service/training/training_lessons.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <utility>

#include "core/as_size.h"

namespace curlew {
namespace {

constexpr int kExposures = 64;    // at one time
constexpr int kVisits = 2;        // of each node, each time turned and cut anew
constexpr double kKeptFar = 0.3;  // part of the nodes without a vortex near that is used

}  // namespace

std::vector<Symmetry> all_symmetries() {
  std::vector<Symmetry> all;
  for (const bool transpose : {false, true})
    for (const int sx : {1, -1})
      for (const int sy : {1, -1}) all.emplace_back(transpose, sx, sy);
  return all;
}

Symmetry::Symmetry(bool transpose_first, int sign_x, int sign_y)
    : transpose(transpose_first), sx(sign_x), sy(sign_y) {
  for (int row = 0; row < kPatch; ++row) {
    for (int col = 0; col < kPatch; ++col) {
      const int x = transpose ? row : col;
      const int y = transpose ? col : row;
      const int to_col = sx > 0 ? x : kPatch - 1 - x;
      const int to_row = sy > 0 ? y : kPatch - 1 - y;
      lenslet[as_size(to_row * kPatch + to_col)] = row * kPatch + col;
    }
  }
  for (int i = 0; i < kSpotFeatures; ++i) {
    feature[as_size(i)] = i;
    sign[as_size(i)] = 1.0F;
    if (i >= kSpotModes) continue;
    const SpotMode mode = spot_mode(i);
    if (transpose) feature[as_size(i)] = spot_mode_index({mode.n, mode.m});
    if ((mode.m % 2 == 1 && sx < 0) != (mode.n % 2 == 1 && sy < 0)) sign[as_size(i)] = -1.0F;
  }
}

Label Symmetry::operator()(const Label& label) const {
  Label turned = label;
  turned.dx = static_cast<float>(sx) * (transpose ? label.dy : label.dx);
  turned.dy = static_cast<float>(sy) * (transpose ? label.dx : label.dy);
  return turned;
}

Lessons::Lessons(const std::vector<TrainingField>& fields, std::uint64_t seed)
    : fields_(fields), random_(seed, 1), symmetries_(all_symmetries()) {
  scale_.fill(1.0F);
  expose_anew();
  std::array<double, kSpotFeatures> squares{};
  double n = 0.0;
  for (const Exposure& exposure : exposures_) {
    const Image<float>& features = exposure.features;
    for (std::size_t k = 0; k < features.size(); ++k)
      squares[k % kSpotFeatures] += static_cast<double>(features[k] * features[k]);
    n += static_cast<double>(features.size()) / kSpotFeatures;
  }
  for (int i = 0; i < kSpotFeatures; ++i) {
    double square = squares[as_size(i)];
    if (i < kSpotModes) {  // transposed modes get the same scale
      const SpotMode mode = spot_mode(i);
      square = std::max(square, squares[as_size(spot_mode_index({mode.n, mode.m}))]);
    }
    scale_[as_size(i)] = static_cast<float>(1.0 / std::sqrt(square / n + 1e-12));
  }
}

NodeLabel Lessons::next(float* inputs) {
  if (next_ == nodes_.size()) {
    if (++visits_ % kVisits == 0) expose_anew();
    next_ = 0;
  }
  const Node node = nodes_[next_++];
  const Exposure& exposure = exposures_[as_size(node.exposure)];
  const TrainingField& field = fields_[as_size(exposure.field)];
  const Symmetry& symmetry = symmetries_[static_cast<std::size_t>(8.0 * random_.uniform())];
  const std::uint32_t missing = draw_missing();
  const auto factors = trait_factors(exposure.traits);
  for (int lenslet = 0; lenslet < kPatchLenslets; ++lenslet, inputs += kTaughtInputs) {
    const int from = symmetry.lenslet[as_size(lenslet)];
    const int row = node.row - 1 + from / kPatch;
    const int col = node.col - 1 + from % kPatch;
    if (!exposure.missing.contains(row, col) || exposure.missing(row, col) != 0 ||
        (missing >> lenslet & 1U) != 0) {
      std::fill_n(inputs, kTaughtInputs, 0.0F);
      continue;
    }
    const float* features = &exposure.features(row, col * kSpotFeatures);
    for (std::size_t i = 0; i < kSpotFeatures; ++i)
      inputs[i] = features[symmetry.feature[i]] * symmetry.sign[i] * scale_[i];
    for (std::size_t block = 1; block < kTraitBlocks; ++block) {
      for (std::size_t i = 0; i < kSpotFeatures; ++i)
        inputs[block * kSpotFeatures + i] = factors[block] * inputs[i];
    }
    inputs[kTaughtInputs - 1] = reach_input(exposure.traits);
  }
  const NodeLabel& label =
      field.labels(exposure.first_row + node.row, exposure.first_col + node.col);
  NodeLabel turned{symmetry(label[0]), symmetry(label[1]), symmetry(label[2])};
  if (symmetry.mirrors()) std::swap(turned[0], turned[1]);
  for (Label& kind : turned) kind.weight *= node.weight;
  return turned;
}

std::uint32_t Lessons::draw_missing() {
  constexpr std::array<std::uint32_t, 4> kSides{0x000FU, 0xF000U, 0x1111U, 0x8888U};
  const double u = random_.uniform();
  std::uint32_t missing = 0;
  if (u < 0.12) {
    missing = kSides[static_cast<std::size_t>(u / 0.12 * 4.0)];
  } else if (u < 0.15) {
    const auto first = static_cast<std::size_t>((u - 0.12) / 0.03 * 4.0);
    missing = kSides[first] | kSides[(first + 2) % 4];
  }
  for (const double share : {0.15, 0.05}) {
    if (random_.uniform() < share)
      missing |= 1U << static_cast<unsigned>(random_.uniform() * kPatchLenslets);
  }
  return missing;
}

void Lessons::expose_anew() {
  const auto start = std::chrono::steady_clock::now();
  exposures_.resize(kExposures);
  nodes_.clear();
  for (int i = 0; i < kExposures; ++i) {
    Exposure& exposure = exposures_[as_size(i)];
    exposure.field = static_cast<int>(random_.uniform() * static_cast<double>(fields_.size()));
    const TrainingField& field = fields_[as_size(exposure.field)];
    const DrawnSensor sensor = draw_sensor(field, random_);
    expose(sensor, draw_noise(sensor.usual, random_), random_, exposure);
    const Image<std::uint8_t>& gone = exposure.missing;
    for (int r = 0; r + 1 < gone.rows(); ++r) {
      for (int c = 0; c + 1 < gone.cols(); ++c) {
        // The classifier does not judge a node that has lost two of its lenslets.
        if (gone(r, c) + gone(r, c + 1) + gone(r + 1, c) + gone(r + 1, c + 1) > 1) continue;
        const bool near = field.near_vortex(exposure.first_row + r, exposure.first_col + c) != 0;
        if (near || random_.uniform() < kKeptFar)
          nodes_.push_back({i, r, c, near ? 1.0F : static_cast<float>(1.0 / kKeptFar)});
      }
    }
  }
  for (std::size_t i = nodes_.size(); i > 1; --i) {
    const auto other = static_cast<std::size_t>(random_.uniform() * static_cast<double>(i));
    std::swap(nodes_[i - 1], nodes_[other]);
  }
  next_ = 0;
  measuring_s_ += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

}  // namespace curlew
