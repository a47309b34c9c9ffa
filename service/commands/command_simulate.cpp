#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <map>
#include <memory>
#include <numbers>
#include <optional>
#include <utility>

#include "acquisition/fits/partial_path.h"
#include "acquisition/recording/recording.h"
#include "acquisition/simulator/field_file.h"
#include "acquisition/simulator/simulator.h"
#include "acquisition/simulator/turbulent_path.h"
#include "core/error.h"
#include "service/commands/commands.h"
#include "service/commands/field_cube.h"
#include "service/commands/force_flag.h"
#include "service/commands/pupil_option.h"
#include "service/commands/simulated_dark.h"
#include "service/program/interrupt.h"
#include "service/program/outputs.h"
#include "service/program/progress.h"
#include "service/program/version.h"

namespace curlew {
namespace {

/// What the user says about the turbulent path. The preset gives the rest.
struct TurbulenceOptions {
  std::optional<double> rytov_variance;
  std::optional<double> r0;  ///< pitches
  std::optional<double> lenslet;
  std::optional<double> outer_scale;
  std::optional<double> inner_scale;
  std::optional<double> waist;
  std::optional<int> screens;
  std::optional<int> grid;
  std::optional<int> grid_samples;
  std::vector<std::string> wind;

  bool any() const {
    return rytov_variance || r0 || lenslet || outer_scale || inner_scale || waist || screens ||
           grid || grid_samples || !wind.empty();
  }
};

struct SimulateOptions {
  std::string preset = "plane";
  std::string out;
  std::string field_out;
  std::string fields_out;
  std::string dark;
  std::int64_t dark_frames = 20;
  double frame_rate_hz = 1000.0;
  SimulatorOptions simulator;
  PresetParameters parameters;
  std::vector<std::string> vortices;
  std::vector<std::string> zernikes;
  std::vector<double> at;
  std::vector<double> tilt;
  std::vector<double> velocity;
  TurbulenceOptions turbulence;
  std::vector<std::string> words;  ///< what was asked for, as option=value
  Existing existing = Existing::kRefused;
};

/// Reads numbers such as "5.5,8,+1,30". Throws UsageError, which names the option.
std::vector<double> numbers(const std::string& text, char separator, const std::string& option,
                            std::size_t minimum, std::size_t maximum, const std::string& form) {
  std::vector<double> values;
  for (const std::string& word : CLI::detail::split(text, separator)) {
    double value = 0.0;
    if (!CLI::detail::lexical_cast(word, value) || !std::isfinite(value)) {
      values.clear();
      break;
    }
    values.push_back(value);
  }
  if (values.size() < minimum || values.size() > maximum)
    throw UsageError(option + " '" + text + "' is not of the form " + form);
  return values;
}

int whole(double value, const std::string& what) {
  if (value != std::floor(value) || std::abs(value) > 1e6)
    throw UsageError(what + " must be a whole number");
  return static_cast<int>(value);
}

SceneVortex vortex_from(const std::string& text) {
  const auto v = numbers(text, ',', "--vortex", 3, 5, "X,Y,CHARGE[,ALPHA_DEG,BETA_DEG]");
  const double radians = std::numbers::pi / 180.0;
  return {v[0], v[1], whole(v[2], "the charge of --vortex"), v.size() > 3 ? v[3] * radians : 0.0,
          v.size() > 4 ? v[4] * radians : 0.0};
}

SceneZernike zernike_from(const std::string& text) {
  const auto v = numbers(text, ':', "--zernike", 2, 2, "NOLL:RMS_RAD");
  return {whole(v[0], "the Noll index of --zernike"), v[1]};
}

/// Returns the Rytov variance of a path with this fried_parameter(), √(λL).
double rytov_variance_for(double r0) {
  TurbulentPath path;
  path.rytov_variance = 1.0;
  return std::pow(fried_parameter(path) / r0, 5.0 / 3.0);
}

void complete_path(const TurbulenceOptions& options, std::optional<TurbulentPath>& path) {
  if (!path) {
    if (options.any()) {
      throw UsageError(
          "an option of the turbulent path needs --preset turbulence or --preset chen2007");
    }
    return;
  }
  path->rytov_variance = options.rytov_variance.value_or(path->rytov_variance);
  path->lenslet = options.lenslet.value_or(path->lenslet);
  if (options.r0) {
    if (options.rytov_variance)
      throw UsageError("--r0 and --rytov-variance say the same in two ways; give one of them");
    path->rytov_variance = rytov_variance_for(*options.r0 * path->lenslet);
  }
  path->outer_scale = options.outer_scale.value_or(path->outer_scale);
  path->inner_scale = options.inner_scale.value_or(path->inner_scale);
  path->waist = options.waist.value_or(path->waist);
  path->screens = options.screens.value_or(path->screens);
  path->grid = options.grid.value_or(path->grid);
  path->grid_samples = options.grid_samples.value_or(path->grid_samples);
  for (const std::string& text : options.wind) {
    const auto v = numbers(text, ',', "--wind", 2, 2, "VX,VY");
    path->wind.push_back({v[0], v[1]});
  }
}

SimulatorOptions simulator_options(const SimulateOptions& options) {
  SimulatorOptions simulator = options.simulator;
  PresetParameters parameters = options.parameters;
  if (!options.at.empty()) {
    parameters.x = options.at[0];
    parameters.y = options.at[1];
  }
  Scene& scene = simulator.scene;
  for (const std::string& text : options.vortices) scene.vortices.push_back(vortex_from(text));
  for (const std::string& text : options.zernikes) scene.zernikes.push_back(zernike_from(text));
  const bool listed = (options.preset == "vortex" && !options.vortices.empty()) ||
                      (options.preset == "zernike" && !options.zernikes.empty()) ||
                      (options.preset == "tilt" && !options.tilt.empty());
  if (!listed) add_preset(options.preset, parameters, simulator);
  if (!options.tilt.empty()) {
    scene.tilt_x_rad = options.tilt[0];
    scene.tilt_y_rad = options.tilt[1];
  }
  if (!options.velocity.empty()) {
    scene.velocity_x = options.velocity[0];
    scene.velocity_y = options.velocity[1];
  }
  complete_path(options.turbulence, simulator.turbulence);
  return simulator;
}

/// Says in advance what the turbulence will cost in memory.
void print_grid(const SimulatorOptions& simulator) {
  const PropagationGrid grid = propagation_grid(simulator);
  fmt::print("propagation: {} x {} points, {:.3g} x {:.3g} √(λL), {} screens, {:.0f} MB\n",
             grid.points, grid.points, grid.points * grid.spacing, grid.points * grid.spacing,
             simulator.turbulence->screens, static_cast<double>(grid.memory_bytes) * 1e-6);
  fmt::print("turbulence: Rytov variance {:.3g}, r0 {:.3g} pitches\n",
             simulator.turbulence->rytov_variance,
             fried_parameter(*simulator.turbulence) / simulator.turbulence->lenslet);
  std::fflush(stdout);
}

void print_time(double frame_s, std::int64_t frames) {
  fmt::print("{:.2g} s a frame, {:.2g} s in all\n", frame_s, frame_s * static_cast<double>(frames));
  std::fflush(stdout);
}

/// Refuses outputs that are there already, that are the field that is read, or each other.
void check_outputs(const SimulateOptions& options) {
  const std::array<std::pair<const char*, const std::string*>, 4> outputs{
      {{"--out", &options.out},
       {"--field-out", &options.field_out},
       {"--fields-out", &options.fields_out},
       {"--dark", &options.dark}}};
  for (std::size_t i = 0; i < outputs.size(); ++i) {
    const auto& [option, path] = outputs[i];
    check_output(*path, {options.parameters.field_file}, options.existing);
    for (std::size_t j = 0; j < i; ++j) {
      if (!path->empty() && !outputs[j].second->empty() &&
          target_of(*path) == target_of(*outputs[j].second))
        throw UsageError(
            fmt::format("{} and {} name the same file {}", outputs[j].first, option, *path));
    }
  }
}

void simulate(const SimulateOptions& options) {
  if (options.simulator.frames < 1) throw UsageError("--frames must be at least 1");
  check_outputs(options);
  const SimulatorOptions simulated = simulator_options(options);
  check_simulator_options(simulated);
  if (!options.dark.empty())
    write_dark(options.dark, options.dark_frames, simulated, options.words);
  if (simulated.turbulence) print_grid(simulated);
  const auto begin = std::chrono::steady_clock::now();
  Simulator simulator(simulated);  // this simulates the first frame too
  const std::chrono::duration<double> first_frame = std::chrono::steady_clock::now() - begin;
  if (simulated.turbulence) print_time(first_frame.count(), simulated.frames);
  Provenance provenance(kProgram);
  provenance.seed = static_cast<std::int64_t>(options.simulator.seed);
  provenance.history = options.words;
  RecordingWriter recording(options.out, simulator.format(), simulator.optics(),
                            simulator.detector(), provenance);
  FrameBuffer frame(simulator.format());
  std::optional<FieldCubeWriter> fields;
  if (!options.fields_out.empty()) fields.emplace(options.fields_out, options.simulator.frames);
  std::vector<TruthVortex> truth;
  std::int64_t saturated = 0;
  {
    Progress progress("simulate", options.simulator.frames);
    while (!interrupted() && simulator.next(frame) == Delivery::kFrame) {
      for (const TruthVortex& vortex : simulator.truth(recording.frames())) truth.push_back(vortex);
      frame.header.camera_ns =
          std::llround(static_cast<double>(frame.header.sequence) * 1e9 / options.frame_rate_hz);
      if (fields) fields->append(simulator.field(recording.frames()));
      recording.append(frame.view(), frame.header);
      saturated += (frame.header.status & kFrameSaturated) != 0 ? 1 : 0;
      progress.step();
    }
  }
  if (!options.field_out.empty()) write_sampled_field(options.field_out, simulator.field(0));
  // An interrupted run has written too few fields for its cube.
  if (fields && !interrupted()) fields->commit();
  recording.write_truth(truth);
  recording.commit();
  const FrameFormat& format = simulator.format();
  fmt::print("{}: {} frames of {} x {} px, {} x {} lenslets, {} true vortices in all\n",
             options.out, recording.frames(), format.cols, format.rows, options.simulator.cols,
             options.simulator.rows, truth.size());
  if (saturated > 0)
    fmt::print("{} frames have saturated pixels: lower --photons or raise --e-per-adu\n",
               saturated);
  if (interrupted())
    throw Failure(fmt::format("interrupted: {} holds the first {} of {} frames", options.out,
                              recording.frames(), simulated.frames));
}

void add_turbulence(CLI::App& command, TurbulenceOptions& path) {
  const std::string group = "Presets turbulence and chen2007 (lengths across the path in √(λL))";
  command
      .add_option(
          "--rytov-variance", path.rytov_variance,
          "Rytov variance of a plane wave, 1.23 Cn² k^(7/6) L^(11/6) [turbulence 1, chen2007 1.05]")
      ->group(group);
  command
      .add_option("--r0", path.r0,
                  "Fried's parameter of the whole path for a plane wave, pitches; in place of the "
                  "Rytov variance")
      ->check(CLI::PositiveNumber)
      ->group(group);
  command.add_option("--lenslet", path.lenslet, "side of a lenslet, √(λL) [.064, .0795]")
      ->group(group);
  command.add_option("--outer-scale", path.outer_scale, "outer scale L0, √(λL) [400, 397]")
      ->group(group);
  command.add_option("--inner-scale", path.inner_scale, "inner scale l0, √(λL) [.02, .02]")
      ->group(group);
  command
      .add_option("--waist", path.waist,
                  "1/e² radius of a collimated Gaussian beam, √(λL); 0: plane wave [0, 1.19]")
      ->group(group);
  command.add_option("--screens", path.screens, "number of phase screens [10, 10]")->group(group);
  command.add_option("--grid", path.grid, "points along a side of the grid; 0: chosen [0, 1024]")
      ->group(group);
  command
      .add_option("--grid-samples", path.grid_samples,
                  "points along a lenslet's side; 0: chosen [0, 10]")
      ->group(group);
  command
      .add_option(
          "--wind", path.wind,
          "wind VX,VY in pitches a frame, repeatable: for all screens, or from the first screen "
          "to the last. Without it every frame is a realisation of its own")
      ->group(group);
}

void add_sensor_options(CLI::App& command, SimulatorOptions& simulator) {
  command.add_option("--rows", simulator.rows, "lenslet rows")->capture_default_str();
  command.add_option("--cols", simulator.cols, "lenslet columns")->capture_default_str();
  command.add_option("--window", simulator.window_px, "pixels per lenslet side")
      ->capture_default_str();
  command.add_option("--sampling", simulator.samples_per_lambda_w, "pixels per λ/w in the focus")
      ->capture_default_str();
  add_pupil_option(command, simulator.pupil);
  command
      .add_option("--obscuration", simulator.obscuration,
                  "obscured part of the obscured pupil's diameter")
      ->capture_default_str();
  command
      .add_option("--stray", simulator.stray_light,
                  "what becomes of light beyond its window: cropped (default) or neighbours")
      ->transform(CLI::CheckedTransformer(std::map<std::string, StrayLight>{
          {"cropped", StrayLight::kCropped}, {"neighbours", StrayLight::kNeighbours}}));
  command
      .add_option("--photons", simulator.photons, "mean electrons of a lit lenslet; 0: no noise")
      ->capture_default_str();
  command.add_option("--background", simulator.background_e, "background, electrons a pixel")
      ->capture_default_str();
  command.add_option("--read-noise", simulator.read_noise_e, "read noise, electrons rms")
      ->capture_default_str();
  command.add_option("--e-per-adu", simulator.e_per_adu, "detector gain, electrons per ADU")
      ->capture_default_str();
  command.add_option("--bias", simulator.bias_adu, "ADU added to every pixel")
      ->capture_default_str();
  command
      .add_option("--saturation", simulator.saturation_adu,
                  "ADU at which a pixel saturates; 0: where the bits end")
      ->capture_default_str();
  command.add_option("--bits", simulator.bit_depth, "bits of the converter: 8, or 10 to 16")
      ->capture_default_str();
}

void add_scene_options(CLI::App& command, SimulateOptions& options) {
  SimulatorOptions& simulator = options.simulator;
  PresetParameters& parameters = options.parameters;
  command.add_option("--vortex", options.vortices,
                     "vortex X,Y,CHARGE[,ALPHA_DEG,BETA_DEG] in lenslet units, repeatable");
  command.add_option("--zernike", options.zernikes, "Zernike mode NOLL:RMS_RAD, repeatable");
  command.add_option("--tilt", options.tilt, "tilt SX,SY in rad per pitch")
      ->delimiter(',')
      ->expected(2);
  command.add_option("--at", options.at, "place X,Y of the dipole's positive vortex")
      ->delimiter(',')
      ->expected(2);
  command.add_option("--separation", parameters.separation, "separation of the dipole, pitches")
      ->capture_default_str();
  command.add_option("--field", parameters.field_file, "complex field [2, ny, nx] to read (FITS)");
  command.add_option("--field-out", options.field_out,
                     "file for the first frame's field at the lenslets, as --field reads it");
  command.add_option("--fields-out", options.fields_out,
                     "file for the fields of all frames, [frames, 2, ny, nx]");
  command
      .add_option("--frame-rate", options.frame_rate_hz, "frames a second, by the camera's clock")
      ->check(CLI::Range(1e-3, 1e9))
      ->capture_default_str();
  command.add_option("--dark", options.dark,
                     "a second recording, of the same camera without any light");
  command.add_option("--dark-frames", options.dark_frames, "number of frames of --dark")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  command
      .add_option("--amplitude", simulator.scene.vortex_amplitude,
                  "amplitude round a vortex: uniform (default, as the paper) or linear")
      ->transform(CLI::CheckedTransformer(std::map<std::string, VortexAmplitude>{
          {"uniform", VortexAmplitude::kUniform}, {"linear", VortexAmplitude::kLinearCore}}));
  command
      .add_option("--core-radius", simulator.scene.core_radius,
                  "radius at which a linear amplitude reaches 1, pitches")
      ->capture_default_str();
  command
      .add_option("--velocity", options.velocity, "velocity VX,VY of the vortices, pitches a frame")
      ->delimiter(',')
      ->expected(2);
}

}  // namespace

void add_simulate(CLI::App& app) {
  auto options = std::make_shared<SimulateOptions>();
  SimulatorOptions& simulator = options->simulator;
  CLI::App* command =
      app.add_subcommand("simulate", "Write physical-optics frames with their truth");
  std::string presets;
  for (const std::string& name : simulator_presets())
    presets += (presets.empty() ? "" : ", ") + name;
  command->add_option("--preset", options->preset, presets)->capture_default_str();
  command->add_option("--out", options->out, "the recording (FITS)")->required();
  add_force_flag(*command, options->existing);
  command->add_option("--frames", simulator.frames, "number of frames")->capture_default_str();
  command->add_option("--seed", simulator.seed, "seed of noise and turbulence")
      ->capture_default_str();
  add_sensor_options(*command, simulator);
  add_scene_options(*command, *options);
  add_turbulence(*command, options->turbulence);
  command->callback([options, command] {
    options->words = {"curlew simulate with:"};
    // The names of files say nothing of what is simulated.
    for (const std::string& line : lines_of(command->config_to_str(true)))
      if (!line.empty() && line.rfind("out=", 0) != 0 && line.rfind("field-out=", 0) != 0 &&
          line.rfind("fields-out=", 0) != 0 && line.rfind("dark=", 0) != 0 &&
          line.rfind("force", 0) != 0)
        options->words.push_back(line);
    simulate(*options);
  });
}

}  // namespace curlew
