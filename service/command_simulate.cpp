#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <map>
#include <memory>
#include <numbers>

#include "acquisition/recording.h"
#include "acquisition/simulator.h"
#include "core/error.h"
#include "service/commands.h"
#include "service/interrupt.h"
#include "service/outputs.h"
#include "service/progress.h"
#include "service/version.h"

namespace curlew {
namespace {

struct SimulateOptions {
  std::string preset = "plane";
  std::string out;
  SimulatorOptions simulator;
  PresetParameters parameters;
  std::vector<std::string> vortices;
  std::vector<std::string> zernikes;
  std::vector<double> at;
  std::vector<double> tilt;
  std::vector<double> velocity;
};

/// "5.5,8,+1,30" → numbers; UsageError names the option.
std::vector<double> numbers(const std::string& text, char separator, const std::string& option,
                            std::size_t least, std::size_t most, const std::string& form) {
  std::vector<double> values;
  for (const std::string& word : CLI::detail::split(text, separator)) {
    double value = 0.0;
    if (!CLI::detail::lexical_cast(word, value) || !std::isfinite(value)) {
      values.clear();
      break;
    }
    values.push_back(value);
  }
  if (values.size() < least || values.size() > most)
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
  return simulator;
}

void simulate(const SimulateOptions& options) {
  if (options.simulator.frames < 1) throw UsageError("--frames must be at least 1");
  refuse_overwriting(options.out, {options.parameters.field_file});
  Simulator simulator(simulator_options(options));
  RecordingWriter recording(options.out, simulator.format(), simulator.optics(),
                            simulator.detector(), kProgram);
  FrameBuffer frame(simulator.format());
  std::vector<TruthVortex> truth;
  std::int64_t saturated = 0;
  {
    Progress progress("simulate", options.simulator.frames);
    while (!interrupted() && simulator.next(frame) == Delivery::kFrame) {
      for (const TruthVortex& vortex : simulator.truth(recording.frames())) truth.push_back(vortex);
      recording.append(frame.view(), frame.header);
      saturated += (frame.header.status & kFrameSaturated) != 0 ? 1 : 0;
      progress.step();
    }
  }
  recording.write_truth(truth);
  recording.commit();
  const FrameFormat& format = simulator.format();
  fmt::print("{}: {} frames of {} x {} px, {} x {} lenslets, {} true vortices in all\n",
             options.out, recording.frames(), format.cols, format.rows, options.simulator.cols,
             options.simulator.rows, truth.size());
  if (saturated > 0)
    fmt::print("{} frames have saturated pixels: lower --photons or raise --e-per-adu\n",
               saturated);
}

}  // namespace

void add_simulate(CLI::App& app) {
  auto options = std::make_shared<SimulateOptions>();
  SimulatorOptions& simulator = options->simulator;
  PresetParameters& parameters = options->parameters;
  CLI::App* command =
      app.add_subcommand("simulate", "Write physical-optics frames with their truth");
  std::string presets;
  for (const std::string& name : simulator_presets())
    presets += (presets.empty() ? "" : ", ") + name;
  command->add_option("--preset", options->preset, presets)->capture_default_str();
  command->add_option("--out", options->out, "the recording (FITS)")->required();
  command->add_option("--frames", simulator.frames, "how many")->capture_default_str();
  command->add_option("--seed", simulator.seed, "of the noise")->capture_default_str();
  command->add_option("--rows", simulator.rows, "lenslet rows")->capture_default_str();
  command->add_option("--cols", simulator.cols, "lenslet columns")->capture_default_str();
  command->add_option("--window", simulator.window_px, "pixels per lenslet side")
      ->capture_default_str();
  command->add_option("--sampling", simulator.samples_per_lambda_w, "pixels per λ/w in the focus")
      ->capture_default_str();
  command->add_option("--pupil", simulator.pupil, "square, round or obscured")
      ->transform(CLI::CheckedTransformer(
          std::map<std::string, PupilShape>{{"square", PupilShape::kSquare},
                                            {"round", PupilShape::kRound},
                                            {"obscured", PupilShape::kObscured}}));
  command->add_option("--obscuration", simulator.obscuration, "of the obscured pupil's diameter")
      ->capture_default_str();
  command
      ->add_option("--stray", simulator.stray_light,
                   "light beyond its window: cropped (default) "
                   "or neighbours")
      ->transform(CLI::CheckedTransformer(std::map<std::string, StrayLight>{
          {"cropped", StrayLight::kCropped}, {"neighbours", StrayLight::kNeighbours}}));
  command->add_option("--photons", simulator.photons, "electrons a lit lenslet; 0: no noise")
      ->capture_default_str();
  command->add_option("--background", simulator.background_e, "electrons a pixel")
      ->capture_default_str();
  command->add_option("--read-noise", simulator.read_noise_e, "electrons rms")
      ->capture_default_str();
  command->add_option("--e-per-adu", simulator.e_per_adu, "electrons per count")
      ->capture_default_str();
  command->add_option("--bias", simulator.bias_adu, "counts added to every pixel")
      ->capture_default_str();
  command->add_option("--saturation", simulator.saturation_adu, "counts; 0: where the bits end")
      ->capture_default_str();
  command->add_option("--bits", simulator.bit_depth, "8, or 10 to 16")->capture_default_str();
  command->add_option("--vortex", options->vortices,
                      "X,Y,CHARGE[,ALPHA_DEG,BETA_DEG] in lenslet units, repeatable");
  command->add_option("--zernike", options->zernikes, "NOLL:RMS_RAD, repeatable");
  command->add_option("--tilt", options->tilt, "SX,SY in rad per pitch")
      ->delimiter(',')
      ->expected(2);
  command->add_option("--at", options->at, "X,Y of the dipole's positive vortex")
      ->delimiter(',')
      ->expected(2);
  command->add_option("--separation", parameters.separation, "of the dipole, pitches")
      ->capture_default_str();
  command->add_option("--field", parameters.field_file, "complex field [2, ny, nx] in FITS");
  command
      ->add_option("--amplitude", simulator.scene.vortex_amplitude,
                   "round a vortex: uniform (default, as the paper) or linear")
      ->transform(CLI::CheckedTransformer(std::map<std::string, VortexAmplitude>{
          {"uniform", VortexAmplitude::kUniform}, {"linear", VortexAmplitude::kLinearCore}}));
  command
      ->add_option("--core-radius", simulator.scene.core_radius,
                   "where a linear amplitude reaches 1, pitches")
      ->capture_default_str();
  command->add_option("--velocity", options->velocity, "VX,VY of the vortices, pitches a frame")
      ->delimiter(',')
      ->expected(2);
  command->callback([options] { simulate(*options); });
}

}  // namespace curlew
