#include "service/bench/tracking_dataset.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <filesystem>
#include <mutex>
#include <optional>
#include <tuple>
#include <utility>

#include "acquisition/fits/fits_file.h"
#include "acquisition/simulator/simulator.h"
#include "core/as_size.h"
#include "core/error.h"
#include "service/program/hash.h"
#include "service/program/parallel.h"
#include "service/results/memory_table.h"

namespace curlew {
namespace {

constexpr int kPartFrames = 50;
constexpr int kFirstSequence = 500'000;  // the first index of a subset that sequences use
constexpr int kCacheVersion = 1;

/// Returns the file of some frames of a sequence, from frame part·kPartFrames on.
std::string path_of(const SequenceParameters& s, std::uint64_t seed, int part,
                    const std::string& folder) {
  const FieldParameters& p = s.field;
  std::string key = fmt::format(
      "sequence {} rytov {} lenslet {} array {}x{} window {} sampling {} arrays {} steps {} part "
      "{} "
      "wind",
      kCacheVersion, p.rytov_variance, p.lenslet, p.rows, p.cols, p.window_px,
      p.samples_per_lambda_w, s.arrays, s.steps, kPartFrames);
  for (const Wind& wind : s.wind) key += fmt::format(" {} {}", wind.x, wind.y);
  return (std::filesystem::path(folder) / fmt::format("{:016x}-{}-{}.fits", fnv1a(key), seed, part))
      .string();
}

/// Returns the parameters of the field of all arrays together.
FieldParameters all_arrays(const SequenceParameters& parameters) {
  FieldParameters all = parameters.field;
  all.rows *= parameters.arrays;
  all.cols *= parameters.arrays;
  return all;
}

FieldSequence simulate_part(const SequenceParameters& parameters, std::uint64_t seed, int part,
                            int frames) {
  SimulatorOptions options = simulator_options(all_arrays(parameters), seed);
  options.turbulence->wind = parameters.wind;
  for (Wind& wind : options.turbulence->wind) {
    wind.x /= parameters.steps;
    wind.y /= parameters.steps;
  }
  Simulator simulator(options);
  FieldSequence sequence;
  for (int step = 0; step < frames * parameters.steps; ++step) {
    const std::int64_t at = std::int64_t{part} * kPartFrames * parameters.steps + step;
    if (step % parameters.steps == 0) sequence.light.push_back(simulator.expected_image_e(at));
    sequence.vortices.push_back(simulator.vortices(at));
  }
  return sequence;
}

std::optional<FieldSequence> read_part(const SequenceParameters& parameters,
                                       const std::string& path) {
  std::error_code error;
  if (!std::filesystem::exists(path, error)) return std::nullopt;
  try {
    const FieldParameters p = all_arrays(parameters);
    FitsFile file = FitsFile::open(path);
    FieldSequence sequence;
    sequence.light.assign(kPartFrames, {p.rows * p.window_px, p.cols * p.window_px});
    const auto pixels = static_cast<std::int64_t>(sequence.light.front().size());
    if (file.image().elements() != kPartFrames * pixels) return std::nullopt;
    std::int64_t first = 0;
    for (Image<float>& light : sequence.light) {
      file.read_pixels<float>(first, {light.data(), light.size()});
      first += pixels;
    }
    file.select("VORTICES");
    const auto n = static_cast<std::size_t>(file.row_count());
    std::vector<double> x(n), y(n);
    std::vector<std::int32_t> step(n), charge(n);
    file.read_column<std::int32_t>("STEP", 0, step);
    file.read_column<double>("X", 0, x);
    file.read_column<double>("Y", 0, y);
    file.read_column<std::int32_t>("CHARGE", 0, charge);
    sequence.vortices.resize(as_size(kPartFrames) * as_size(parameters.steps));
    for (std::size_t i = 0; i < n; ++i)
      sequence.vortices.at(as_size(step[i])).push_back({x[i], y[i], charge[i], 0.0, 0.0});
    return sequence;
  } catch (const Failure&) {
    return std::nullopt;
  } catch (const std::out_of_range&) {
    return std::nullopt;
  }
}

void write_part(const FieldSequence& sequence, std::uint64_t seed, const std::string& path) {
  MemoryTable vortices("VORTICES",
                       {{"STEP", 'J', ""}, {"X", 'D', ""}, {"Y", 'D', ""}, {"CHARGE", 'J', ""}});
  for (std::size_t step = 0; step < sequence.vortices.size(); ++step)
    for (const SceneVortex& vortex : sequence.vortices[step])
      vortices.append(step, vortex.x, vortex.y, vortex.charge);
  FitsFile file = FitsFile::create(path);
  const Image<float>& light = sequence.light.front();
  file.create_image(ElementType::kF32, {kPartFrames, light.rows(), light.cols()});
  file.write_key("SEED", static_cast<std::int64_t>(seed));
  std::int64_t first = 0;
  for (const Image<float>& one : sequence.light) {
    file.write_pixels<float>(first, {one.data(), one.size()});
    first += static_cast<std::int64_t>(one.size());
  }
  vortices.write(file);
  file.commit();
}

/// Puts what one array sees of a part's frames in their place, from frame `first` on.
void cut(const FieldSequence& all, const SequenceParameters& parameters, int array, int first,
         FieldSequence& sequence) {
  constexpr double kMargin = 4.0;  // pitches
  const FieldParameters& p = parameters.field;
  const int row = array / parameters.arrays * p.rows;
  const int col = array % parameters.arrays * p.cols;
  for (std::size_t i = 0; i < all.light.size(); ++i) {
    const std::size_t frame = as_size(first) + i;
    if (frame >= sequence.light.size()) break;
    Image<float> light(p.rows * p.window_px, p.cols * p.window_px);
    for (int y = 0; y < light.rows(); ++y)
      std::copy_n(&all.light[i](row * p.window_px + y, col * p.window_px), light.cols(),
                  &light(y, 0));
    sequence.light[frame] = std::move(light);
  }
  for (std::size_t i = 0; i < all.vortices.size(); ++i) {
    const std::size_t step = as_size(first) * as_size(parameters.steps) + i;
    if (step >= sequence.vortices.size()) break;
    for (SceneVortex vortex : all.vortices[i]) {
      vortex.x -= col;
      vortex.y -= row;
      if (std::abs(vortex.x - 0.5 * (p.cols - 1)) < 0.5 * p.cols + kMargin &&
          std::abs(vortex.y - 0.5 * (p.rows - 1)) < 0.5 * p.rows + kMargin)
        sequence.vortices[step].push_back(vortex);
    }
  }
}

}  // namespace

std::uint64_t sequence_seed(Subset subset, int index) {
  return realisation_seed(subset, kFirstSequence + index);
}

int sequence_parts(int frames) { return (frames + kPartFrames - 1) / kPartFrames; }

int kept_parts(const SequenceParameters& parameters, std::uint64_t seed, int frames,
               const std::string& folder) {
  int kept = 0;
  std::error_code error;
  for (int part = 0; part < sequence_parts(frames); ++part) {
    if (!folder.empty() && std::filesystem::exists(path_of(parameters, seed, part, folder), error))
      ++kept;
  }
  return kept;
}

std::vector<FieldSequence> read_or_simulate(const SequenceParameters& parameters,
                                            std::uint64_t seed, int frames,
                                            const std::string& folder, int threads,
                                            const std::function<void()>& step) {
  if (parameters.steps < 1 || parameters.arrays < 1)
    throw UsageError("arrays and steps must be 1 or more");
  make_cache_folder(folder);
  std::vector<FieldSequence> sequences(as_size(parameters.arrays) * as_size(parameters.arrays));
  for (FieldSequence& sequence : sequences) {
    sequence.light.resize(as_size(frames));
    sequence.vortices.resize(as_size(frames) * as_size(parameters.steps));
  }
  std::mutex stepping;
  for_each_in_parallel(sequence_parts(frames), threads, [&](int part, int) {
    const std::string path = folder.empty() ? "" : path_of(parameters, seed, part, folder);
    std::optional<FieldSequence> all;
    if (!path.empty()) all = read_part(parameters, path);
    if (!all) {
      const int needed = std::min(kPartFrames, frames - part * kPartFrames);
      all = simulate_part(parameters, seed, part, path.empty() ? needed : kPartFrames);
      if (!path.empty()) write_part(*all, seed, path);
    }
    for (std::size_t i = 0; i < sequences.size(); ++i)
      cut(*all, parameters, static_cast<int>(i), part * kPartFrames, sequences[i]);
    const std::scoped_lock lock(stepping);
    step();
  });
  return sequences;
}

std::vector<std::vector<int>> identify_vortices(std::span<const std::vector<SceneVortex>> steps,
                                                double max_jump) {
  struct Known {
    double x, y;  // where it should be now
  };
  std::vector<std::vector<int>> identities(steps.size());
  std::vector<Known> expected;
  int next = 0;
  for (std::size_t step = 0; step < steps.size(); ++step) {
    const std::vector<SceneVortex>& now = steps[step];
    std::vector<int>& ids = identities[step];
    ids.assign(now.size(), -1);
    std::vector<Known> after(now.size());
    for (std::size_t i = 0; i < now.size(); ++i) after[i] = {now[i].x, now[i].y};
    if (step > 0) {
      const std::vector<SceneVortex>& before = steps[step - 1];
      std::vector<std::tuple<double, std::size_t, std::size_t>> near;
      for (std::size_t i = 0; i < before.size(); ++i) {
        for (std::size_t j = 0; j < now.size(); ++j) {
          const double away = std::hypot(expected[i].x - now[j].x, expected[i].y - now[j].y);
          if (before[i].charge == now[j].charge && away < max_jump) near.emplace_back(away, i, j);
        }
      }
      std::sort(near.begin(), near.end());
      std::vector<bool> gone(before.size(), false);
      for (const auto& [away, i, j] : near) {
        if (gone[i] || ids[j] >= 0) continue;
        gone[i] = true;
        ids[j] = identities[step - 1][i];
        after[j] = {2.0 * now[j].x - before[i].x, 2.0 * now[j].y - before[i].y};
      }
    }
    for (int& id : ids)
      if (id < 0) id = next++;
    expected = std::move(after);
  }
  return identities;
}

}  // namespace curlew
