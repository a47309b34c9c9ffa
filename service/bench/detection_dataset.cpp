#include "service/bench/detection_dataset.h"

#include <spdlog/fmt/fmt.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <span>
#include <utility>

#include "acquisition/fits/fits_file.h"
#include "acquisition/simulator/simulator.h"
#include "core/error.h"
#include "service/program/hash.h"
#include "service/results/memory_table.h"

namespace curlew {
namespace {

constexpr int kSeedsPerSubset = 1'000'000;
constexpr std::uint64_t kFirstTrainingSeed = 1'000'000;
constexpr std::uint64_t kFirstValidationSeed = 2'000'000;
constexpr std::uint64_t kFirstTestSeed = 3'000'000;

/// This is the version of the files' layout, and of what the parameters do not say, such as the
/// path's screens.
constexpr int kCacheVersion = 1;

}  // namespace

std::uint64_t realisation_seed(Subset subset, int index) {
  if (index < 0 || index >= kSeedsPerSubset)
    throw UsageError("a subset of the realisations has 1,000,000 of them; ask for fewer");
  const auto i = static_cast<std::uint64_t>(index);
  switch (subset) {
    case Subset::kTraining:
      return kFirstTrainingSeed + i;
    case Subset::kValidation:
      return kFirstValidationSeed + i;
    case Subset::kTest:
      break;
  }
  return kFirstTestSeed + i;
}

SimulatorOptions simulator_options(const FieldParameters& parameters, std::uint64_t seed) {
  SimulatorOptions options;
  options.rows = parameters.rows;
  options.cols = parameters.cols;
  options.window_px = parameters.window_px;
  options.samples_per_lambda_w = parameters.samples_per_lambda_w;
  options.stray_light = parameters.neighbours ? StrayLight::kNeighbours : StrayLight::kCropped;
  options.photons = 1.0;
  options.seed = seed;
  options.turbulence = TurbulentPath{};
  options.turbulence->rytov_variance = parameters.rytov_variance;
  options.turbulence->lenslet = parameters.lenslet;
  return options;
}

Realisation simulate_realisation(const FieldParameters& parameters, std::uint64_t seed) {
  Simulator simulator(simulator_options(parameters, seed));
  return {simulator.expected_image_e(0), simulator.vortices(0)};
}

RealisationCost realisation_cost(const FieldParameters& parameters) {
  constexpr double kSecondsPerPoint = 9e-8;  // measured, for each point and screen
  constexpr double kSecondsPerLenslet = 5e-5;
  const SimulatorOptions options = simulator_options(parameters, 0);
  const PropagationGrid grid = propagation_grid(options);
  const double points = static_cast<double>(grid.points) * grid.points;
  return {points * options.turbulence->screens * kSecondsPerPoint +
              parameters.rows * parameters.cols * kSecondsPerLenslet,
          static_cast<double>(grid.memory_bytes) * 1e-6};
}

void make_cache_folder(const std::string& folder) {
  if (folder.empty()) return;
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) {
    throw Failure(fmt::format("the folder {} cannot be made: {}; name another with --cache", folder,
                              error.message()));
  }
}

RealisationCache::RealisationCache(std::string folder) : folder_(std::move(folder)) {
  make_cache_folder(folder_);
}

std::string RealisationCache::path_of(const FieldParameters& p, std::uint64_t seed) const {
  const std::string key = fmt::format("{} rytov {} lenslet {} array {}x{} window {} sampling {}",
                                      kCacheVersion, p.rytov_variance, p.lenslet, p.rows, p.cols,
                                      p.window_px, p.samples_per_lambda_w) +
                          (p.neighbours ? " neighbours" : "");
  return (std::filesystem::path(folder_) / fmt::format("{:016x}-{}.fits", fnv1a(key), seed))
      .string();
}

bool RealisationCache::holds(const FieldParameters& parameters, std::uint64_t seed) const {
  std::error_code error;
  return !folder_.empty() && std::filesystem::exists(path_of(parameters, seed), error);
}

std::optional<Realisation> RealisationCache::read(const FieldParameters& parameters,
                                                  std::uint64_t seed) const {
  if (!holds(parameters, seed)) return std::nullopt;
  try {
    FitsFile file = FitsFile::open(path_of(parameters, seed));
    Realisation realisation{
        {parameters.rows * parameters.window_px, parameters.cols * parameters.window_px}, {}};
    if (file.image().elements() != static_cast<std::int64_t>(realisation.light.size()))
      return std::nullopt;
    file.read_pixels<float>(0, {realisation.light.data(), realisation.light.size()});
    file.select("VORTICES");
    const auto n = static_cast<std::size_t>(file.row_count());
    std::vector<double> x(n), y(n);
    std::vector<std::int32_t> charge(n);
    file.read_column<double>("X", 0, x);
    file.read_column<double>("Y", 0, y);
    file.read_column<std::int32_t>("CHARGE", 0, charge);
    for (std::size_t i = 0; i < n; ++i)
      realisation.vortices.push_back({x[i], y[i], charge[i], 0.0, 0.0});
    return realisation;
  } catch (const Failure&) {
    return std::nullopt;
  }
}

Realisation RealisationCache::read_or_simulate(const FieldParameters& parameters,
                                               std::uint64_t seed) const {
  if (std::optional<Realisation> kept = read(parameters, seed)) return *std::move(kept);
  Realisation realisation = simulate_realisation(parameters, seed);
  if (folder_.empty()) return realisation;
  MemoryTable vortices("VORTICES", {{"X", 'D', ""}, {"Y", 'D', ""}, {"CHARGE", 'J', ""}});
  for (const SceneVortex& vortex : realisation.vortices)
    vortices.append(vortex.x, vortex.y, vortex.charge);
  FitsFile file = FitsFile::create(path_of(parameters, seed));
  const Image<float>& light = realisation.light;
  file.create_image(ElementType::kF32, {light.rows(), light.cols()});
  file.write_key("SEED", static_cast<std::int64_t>(seed));
  file.write_key("RYTOV", parameters.rytov_variance, "Rytov variance");
  file.write_key("LENSLET", parameters.lenslet, "side of a lenslet in sqrt(lambda L)");
  file.write_pixels<float>(0, {light.data(), light.size()});
  vortices.write(file);
  file.commit();
  return realisation;
}

std::string default_realisation_folder() {
  // Nothing in this program sets the environment, so reading it is safe.
  const char* cache = std::getenv("XDG_CACHE_HOME");  // NOLINT(concurrency-mt-unsafe)
  if (cache != nullptr && *cache != '\0') return std::string(cache) + "/curlew/detection";
  const char* home = std::getenv("HOME");  // NOLINT(concurrency-mt-unsafe)
  if (home != nullptr && *home != '\0') return std::string(home) + "/.cache/curlew/detection";
  return {};
}

}  // namespace curlew
