#include "service/training/training_fields.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <tuple>
#include <utility>

#include "core/frame.h"
#include "detect/classifier/spot_features.h"
#include "service/bench/bench_frames.h"
#include "service/results/truth_match.h"
#include "service/spot_camera.h"

namespace curlew {
namespace {

constexpr double kBiasAdu = 100.0;
constexpr double kEPerAdu = 0.25;
constexpr double kReadNoiseE = 1.0;
constexpr double kThresholdE = 3.0;  // threshold of the flux, as for the benchmark's centroids
// In pitches. Between kHitRadius and this a node has no label.
constexpr double kIgnoreRadius = 1.0;

/// Makes counts and fluxes of a field. If photons is infinite, each window reaches the top of the
/// range, and fluxes have no unit.
void expose(const TrainingField& field, double photons, RandomStream& random, FrameBuffer& frame,
            Image<float>& flux_adu) {
  const int window = field.parameters.window_px;
  const bool noisy = std::isfinite(photons);
  auto* counts = reinterpret_cast<std::uint16_t*>(frame.data());
  for (int row = 0; row < flux_adu.rows(); ++row) {
    for (int col = 0; col < flux_adu.cols(); ++col) {
      const auto for_each_pixel = [&](auto&& use) {
        for (int i = row * window; i < (row + 1) * window; ++i)
          for (int j = col * window; j < (col + 1) * window; ++j) use(i, j);
      };
      double flux = 0.0;
      double peak = 0.0;
      for_each_pixel(
          [&](int i, int j) { peak = std::max(peak, static_cast<double>(field.light(i, j))); });
      for_each_pixel([&](int i, int j) {
        const auto light = static_cast<double>(field.light(i, j));
        double adu = peak > 0.0 ? light * 60000.0 / peak : 0.0;
        if (noisy) {
          const double electrons =
              random.poisson(photons * light) + kReadNoiseE * random.gaussian();
          flux += std::max(electrons - kThresholdE, 0.0) / kEPerAdu;
          adu = electrons / kEPerAdu;
        } else {
          flux += light;
        }
        counts[i * field.light.cols() + j] =
            static_cast<std::uint16_t>(std::clamp(std::floor(kBiasAdu + adu + 0.5), 0.0, 65535.0));
      });
      flux_adu(row, col) = static_cast<float>(flux);
    }
  }
}

}  // namespace

FieldParameters training_field(int index) {
  struct Geometry {
    double lenslet;
    int window_px;
    double samples;
  };
  constexpr std::array<double, 5> kRytov{2.0, 1.0, 4.0, 1.4, 2.8};
  constexpr std::array<Geometry, 10> kGeometries{{{0.064, 6, 2.0},
                                                  {0.045, 8, 2.0},
                                                  {0.064, 6, 2.0},
                                                  {0.09, 4, 2.0},
                                                  {0.064, 6, 2.0},
                                                  {0.032, 6, 2.0},
                                                  {0.064, 6, 2.0},
                                                  {0.14, 12, 3.0},
                                                  {0.064, 6, 2.0},
                                                  {0.064, 9, 3.0}}};
  constexpr double kSide = 3.84;  // √(λL), side of the propagated area
  const Geometry& geometry = kGeometries[static_cast<std::size_t>(index / 5) % kGeometries.size()];
  FieldParameters p;
  p.rytov_variance = kRytov[static_cast<std::size_t>(index) % kRytov.size()];
  p.lenslet = geometry.lenslet;
  p.window_px = geometry.window_px;
  p.samples_per_lambda_w = geometry.samples;
  p.rows = p.cols = std::min(60, static_cast<int>(kSide / geometry.lenslet));
  return p;
}

std::vector<UnresolvedPair> unresolved_pairs(const std::vector<GradedVortex>& graded) {
  const auto apart = [](const auto& a, const auto& b) { return std::hypot(a.x - b.x, a.y - b.y); };
  std::vector<std::tuple<double, std::size_t, std::size_t>> near;
  for (std::size_t i = 0; i < graded.size(); ++i) {
    for (std::size_t j = i + 1; j < graded.size(); ++j) {
      if (graded[i].required || graded[j].required || graded[i].charge == graded[j].charge)
        continue;
      const double distance = apart(graded[i], graded[j]);
      if (distance < kClosestRequiredPair) near.emplace_back(distance, i, j);
    }
  }
  std::sort(near.begin(), near.end());
  std::vector<bool> taken(graded.size(), false);
  std::vector<UnresolvedPair> pairs;
  for (const auto& [distance, i, j] : near) {
    if (taken[i] || taken[j]) continue;
    taken[i] = taken[j] = true;
    UnresolvedPair pair{0.5 * (graded[i].x + graded[j].x), 0.5 * (graded[i].y + graded[j].y),
                        distance, distance >= kFaintestPair};
    for (const GradedVortex& other : graded)
      pair.clear = pair.clear && !(other.required && apart(pair, other) < kHitRadius);
    pairs.push_back(pair);
  }
  return pairs;
}

Image<NodeLabel> label_nodes(const FieldParameters& p, const std::vector<GradedVortex>& truth) {
  Image<NodeLabel> labels(p.rows - 1, p.cols - 1);
  Image<std::array<double, 3>> nearest(p.rows - 1, p.cols - 1, {1e9, 1e9, 1e9});
  const auto mark = [&](double x, double y, std::size_t kind, bool certain) {
    const int row = static_cast<int>(std::floor(y));
    const int col = static_cast<int>(std::floor(x));
    for (int r = row - 2; r <= row + 2; ++r) {
      for (int c = col - 2; c <= col + 2; ++c) {
        if (!labels.contains(r, c)) continue;
        const double dx = x - c - 0.5;
        const double dy = y - r - 0.5;
        const double distance = std::hypot(dx, dy);
        Label& label = labels(r, c)[kind];
        if (distance < kIgnoreRadius && label.present == 0.0F) label.weight = 0.0F;
        if (!certain || distance > kHitRadius || distance > nearest(r, c)[kind]) continue;
        nearest(r, c)[kind] = distance;
        label = {1.0F, 1.0F, static_cast<float>(dx), static_cast<float>(dy)};
      }
    }
  };
  for (const GradedVortex& vortex : truth)
    mark(vortex.x, vortex.y, vortex.charge > 0 ? 0 : 1, vortex.required);
  for (const UnresolvedPair& pair : unresolved_pairs(truth)) mark(pair.x, pair.y, 2, pair.clear);
  return labels;
}

TrainingField make_training_field(const FieldParameters& p, Realisation realisation) {
  TrainingField field{p, std::move(realisation.light),
                      label_nodes(p, grade_vortices(realisation.vortices)),
                      Image<std::uint8_t>(p.rows - 1, p.cols - 1)};
  for (const SceneVortex& vortex : realisation.vortices) {
    for (int r = 0; r < p.rows - 1; ++r) {
      if (std::abs(r + 0.5 - vortex.y) > 2.0) continue;
      for (int c = 0; c < p.cols - 1; ++c)
        if (std::abs(c + 0.5 - vortex.x) <= 2.0) field.near_vortex(r, c) = 1;
    }
  }
  return field;
}

void measure(const TrainingField& field, double photons, RandomStream& random, Exposure& exposure) {
  const FieldParameters& p = field.parameters;
  FrameFormat format;
  format.rows = p.rows * p.window_px;
  format.cols = p.cols * p.window_px;
  FrameBuffer frame(format);
  Image<float> flux(p.rows, p.cols);
  expose(field, photons, random, frame, flux);
  SpotCamera camera = spot_camera(tiled_sensor({p.rows, p.cols, p.window_px}));
  camera.pixels_per_lambda_w = p.samples_per_lambda_w;
  camera.background_adu = kBiasAdu;
  camera.e_per_adu = std::isfinite(photons) ? kEPerAdu : 0.0;
  camera.read_noise_e = kReadNoiseE;
  const SpotFeatures features(camera, format);
  double mean = 0.0;
  for (const float value : flux) mean += static_cast<double>(value);
  mean /= static_cast<double>(flux.size());
  exposure.features = Image<float>(p.rows, p.cols * kSpotFeatures);
  for (std::size_t k = 0; k < flux.size(); ++k) {
    features.measure(frame.view(), k, flux[k], static_cast<float>(mean),
                     exposure.features.data() + k * kSpotFeatures);
  }
}

}  // namespace curlew
