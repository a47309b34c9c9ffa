#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <bit>
#include <cmath>
#include <filesystem>
#include <memory>
#include <optional>

#include "acquisition/fits/partial_path.h"
#include "acquisition/pictures/picture_stack.h"
#include "acquisition/recording/fits_source.h"
#include "acquisition/recording/mean_image.h"
#include "acquisition/recording/recording.h"
#include "centroiding/calibration/calibrate.h"
#include "core/error.h"
#include "service/commands/commands.h"
#include "service/commands/force_flag.h"
#include "service/config.h"
#include "service/picture/sensor_picture.h"
#include "service/program/outputs.h"
#include "service/sensor/capture.h"
#include "service/sensor/frame_maps.h"
#include "service/sensor/optics_comparison.h"
#include "service/sensor/recording_calibration.h"
#include "service/sensor/sensor_file.h"
#include "service/sensor/sensor_verdict.h"

namespace curlew {
namespace {

struct CalibrateOptions {
  std::string reference, hdu, region;
  std::string dark, dark_hdu;
  std::string flat, flat_hdu;
  std::string bad_pixels, bad_pixels_hdu;
  std::string make_bad_pixels;
  std::string picture;
  std::string config;
  std::string out;
  std::string camera;
  std::string keep;
  std::int64_t frames = 100;
  bool take_dark = false;
  std::optional<double> pitch_um, focal_mm, pixel_um, wavelength_nm, magnification;
  std::optional<double> e_per_adu, read_noise_e, saturation_adu;
  bool mirror = false;
  Existing existing = Existing::kRefused;
};

/// Replaces what the recording says by what the user gave, in SI units, if it was given.
void apply_option(double& value, const std::optional<double>& given, double unit,
                  const std::string& option, bool zero_allowed = false) {
  if (!given) return;
  if (!std::isfinite(*given) || *given < 0.0 || (*given == 0.0 && !zero_allowed))
    throw UsageError(option + " must be a positive number");
  value = *given * unit;
}

Optics optics_of(const CalibrateOptions& options, Optics optics) {
  apply_option(optics.pitch_m, options.pitch_um, 1e-6, "--pitch-um");
  apply_option(optics.focal_m, options.focal_mm, 1e-3, "--focal-mm");
  apply_option(optics.pixel_m, options.pixel_um, 1e-6, "--pixel-um");
  apply_option(optics.wavelength_m, options.wavelength_nm, 1e-9, "--wavelength-nm");
  constexpr double kShortestM = 1e-8;  // X-rays on one side, millimetre waves on the other
  constexpr double kLongestM = 1e-4;
  if (options.wavelength_nm &&
      (optics.wavelength_m < kShortestM || optics.wavelength_m > kLongestM))
    throw UsageError(fmt::format("--wavelength-nm {:g} is no wavelength of light: give nanometres",
                                 *options.wavelength_nm));
  apply_option(optics.magnification, options.magnification, 1.0, "--magnification");
  optics.mirrored = optics.mirrored || options.mirror;
  std::string missing;
  for (const auto& [value, option] :
       {std::pair{optics.pitch_m, "--pitch-um"}, std::pair{optics.focal_m, "--focal-mm"},
        std::pair{optics.pixel_m, "--pixel-um"}, std::pair{optics.wavelength_m, "--wavelength-nm"}})
    if (!(value > 0.0)) missing.append(missing.empty() ? "" : ", ").append(option);
  if (!missing.empty())
    throw UsageError(options.reference + " does not tell the optics, give " + missing);
  return optics;
}

Detector detector_of(const CalibrateOptions& options, Detector detector) {
  apply_option(detector.e_per_adu, options.e_per_adu, 1.0, "--e-per-adu");
  apply_option(detector.read_noise_e, options.read_noise_e, 1.0, "--read-noise-e", true);
  apply_option(detector.saturation_adu, options.saturation_adu, 1.0, "--saturation-adu");
  return detector;
}

FrameSelection reference_selection(const CalibrateOptions& options) {
  return {.hdu = options.hdu, .region = parse_region(options.region)};
}

CalibrationInput read_input(const CalibrateOptions& options) {
  ReferenceFrameSet reference =
      read_reference_frames(options.reference, reference_selection(options));
  CalibrationInput& input = reference.input;
  if (!options.dark.empty()) {
    const MeanImage dark = read_map(options.dark, reference.mean,
                                    {.hdu = options.dark_hdu, .content = ImageContent::kDark});
    fmt::print("{}: {}\n", options.dark, check_dark(options.dark, dark));
    set_dark(dark, input);
  }
  if (!options.flat.empty())
    input.flat =
        converted<float>(read_map(options.flat, reference.mean,
                                  {.hdu = options.flat_hdu, .content = ImageContent::kFlat})
                             .mean);
  if (!options.bad_pixels.empty()) {
    const MeanImage map =
        read_map(options.bad_pixels, reference.mean,
                 {.hdu = options.bad_pixels_hdu, .content = ImageContent::kBadPixels});
    for (std::size_t i = 0; i < map.mean.size(); ++i) {
      if (map.mean[i] == 0.0) continue;
      if (input.bad_pixel.empty())
        input.bad_pixel = Image<std::uint8_t>(map.mean.rows(), map.mean.cols());
      input.bad_pixel[i] = 1;
    }
  }
  input.optics = optics_of(options, input.optics);
  input.detector = detector_of(options, input.detector);
  return std::move(input);
}

void print_fit(const CalibrateOptions& options, const Sensor& sensor) {
  const LensletGrid& grid = sensor.grid;
  const auto lit = std::count(sensor.valid.begin(), sensor.valid.end(), std::uint8_t{1});
  fmt::print("{}: {} of {} x {} lenslets lit, square layout\n", options.out, lit, grid.cols,
             grid.rows);
  fmt::print("  pitch {:.3f} px, rotation {:+.3f} deg, lenslet (0, 0) at ({:.2f}, {:.2f}) px\n",
             grid.pitch_px(), grid.rotation_deg(), grid.origin_x_px, grid.origin_y_px);
  fmt::print("  spots lie {:.3f} px rms from the grid\n", sensor.residual_px);
  const Optics& optics = sensor.optics;
  fmt::print("  pitch found is {:.4f} of w m / p (optics and the reference beam's curvature)\n",
             grid.pitch_px() * optics.pixel_m / (optics.pitch_m * optics.magnification));
  fmt::print("  one pixel is a slope of {:.4f} rad per pitch\n", optics.slope_rad_per_px());
}

/// Returns what the sensor file says of its origin.
Provenance provenance_of(const CalibrateOptions& options, const Config& config) {
  Provenance provenance = provenance_of(config);
  const std::string& source = options.camera.empty() ? options.reference : options.camera;
  provenance.history.insert(provenance.history.begin(), "calibrated on " + source);
  if (means_pictures(options.reference)) return provenance;  // they have no date
  FitsFile reference = FitsFile::open(options.reference);
  provenance.observed_ns = observed_ns(reference);
  return provenance;
}

/// Finds grid, windows and reference spots from the recording options.reference.
void calibrate_on_recording(const CalibrateOptions& options) {
  const Config config = options.config.empty() ? Config{} : read_config(options.config);
  const FrameSelection selection = reference_selection(options);
  CalibrationInput input = read_input(options);
  input.centroid = config.centroid;
  RecordingCalibration done =
      calibrate_on_frames(options.reference, selection, input, options.reference);
  const Calibration& calibration = done.calibration;
  const Sensor& sensor = calibration.sensor;
  write_sensor(options.out, sensor, provenance_of(options, config));
  print_fit(options, sensor);
  if (!options.picture.empty()) {
    write_sensor_picture(options.picture, sensor, input.reference_adu);
    fmt::print("  {}\n", sensor_picture_legend(options.picture));
  }
  const FitsSource source({options.reference}, selection);
  for (const std::string& note : source.notes()) fmt::print("  {}\n", note);
  if (!source.map_report().empty()) fmt::print("  {}\n", source.map_report());
  // --mirror only adds to what the header says.
  const std::string differing = differing_optics(source.optics(), sensor.optics);
  if (!differing.empty())
    fmt::print(
        "  {} was taken with other optics than the command line gives: {}; the command line "
        "holds\n",
        options.reference, differing);
  for (const std::string& note : calibration.notes) fmt::print("  {}\n", note);
  if (!done.dropped.empty()) fmt::print("  {}\n", done.dropped);
  fmt::print("verdict on the sensor:\n");
  for (const std::string& line : sensor_verdict(sensor, calibration.width_over_diffraction))
    fmt::print("  {}\n", line);
}

/// Takes darks from the camera, and leaves no file where they are lit.
void take_dark(const CameraOptions& camera, const CalibrateOptions& options) {
  const std::string taken = partial_path(options.out + ".dark.fits");
  capture_frames(camera, options.frames, taken);
  try {
    fmt::print("{}: {}\n", options.out, check_dark(options.out, read_mean_image(taken)));
    std::filesystem::rename(taken, replaceable_target(options.out));
  } catch (...) {
    std::filesystem::remove(taken);
    throw;
  }
}

/// Takes frames from the camera into a recording first, which is kept if the user says so.
void calibrate_on_camera(CalibrateOptions options) {
  const Config config = options.config.empty() ? Config{} : read_config(options.config);
  CameraOptions camera = config.camera;
  camera.source = options.camera;
  if (options.take_dark) {
    take_dark(camera, options);
    fmt::print("{}: a stack of {} darks, for --dark\n", options.out, options.frames);
    return;
  }
  options.reference =
      options.keep.empty() ? partial_path(options.out + ".reference.fits") : options.keep;
  capture_frames(camera, options.frames, options.reference);
  const auto discard = [&] {
    if (options.keep.empty()) std::filesystem::remove(options.reference);
  };
  try {
    calibrate_on_recording(options);
  } catch (...) {
    discard();
    throw;
  }
  discard();
}

void check_outputs(const CalibrateOptions& options) {
  const std::vector<std::string> inputs = {options.reference, options.dark,
                                           options.flat,      options.bad_pixels,
                                           options.config,    options.make_bad_pixels};
  for (const std::string& output : {options.out, options.picture, options.keep})
    check_output(output, inputs, options.existing);
  const auto differ = [&](const std::string& option, const std::string& path) {
    if (!path.empty() && target_of(path) == target_of(options.out))
      throw UsageError(option + " and --out name the same file " + options.out);
  };
  differ("--picture", options.picture);
  differ("--keep", options.keep);
}

void calibrate(const CalibrateOptions& options) {
  check_outputs(options);
  if (!options.make_bad_pixels.empty()) {
    make_bad_pixels(options.make_bad_pixels,
                    {.hdu = options.dark_hdu, .content = ImageContent::kDark}, options.flat,
                    {.hdu = options.flat_hdu, .content = ImageContent::kFlat}, options.out);
    return;
  }
  if (!options.dark_hdu.empty() && options.dark.empty())
    throw UsageError("--dark-hdu needs --dark or --make-bad-pixels");
  if (options.camera.empty() == options.reference.empty())
    throw UsageError("give either a reference recording or --camera");
  if (options.camera.empty())
    calibrate_on_recording(options);
  else
    calibrate_on_camera(options);
}

/// Adds the options that say where frames and maps come from. Options without effect are refused.
void add_files(CLI::App& command, CalibrateOptions& options) {
  auto* reference =
      command.add_option("reference", options.reference,
                         "frames of the reference beam: FITS, PNG, TIFF or npy, a directory of "
                         "pictures, or a pattern in quotes");
  command
      .add_option("--hdu", options.hdu,
                  "image of the reference to read, by EXTNAME or number (0: the primary)")
      ->needs(reference);
  command
      .add_option("--region", options.region,
                  "part of each frame to read: X,Y,W,H in px from 0 (default: key DATASEC)")
      ->needs(reference);
  auto* camera =
      command.add_option("--camera", options.camera,
                         "camera to take the frames from: aravis:ID, usb:VID:PID, isio:NAME or "
                         "sim:PRESET");
  command.add_option("--frames", options.frames, "how many frames to take from the camera")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str()
      ->needs(camera);
  command
      .add_option("--keep", options.keep, "recording in which the camera's frames are kept (FITS)")
      ->needs(camera);
  auto* take_dark =
      command
          .add_flag("--take-dark", options.take_dark,
                    "only take frames from the camera, with the light off, into --out")
          ->needs(camera);
  command.add_option("--out", options.out, "the sensor file (FITS)")->required();
  add_force_flag(command, options.existing);
  auto* dark = command.add_option("--dark", options.dark,
                                  "dark frame, or a stack, which also gives the read noise");
  auto* make = command.add_option(
      "--make-bad-pixels", options.make_bad_pixels,
      "only find the bad pixels of this dark stack, and of --flat, and write their map to --out");
  command.add_option("--dark-hdu", options.dark_hdu,
                     "image of --dark, or of --make-bad-pixels, to read, by EXTNAME or number");
  auto* flat = command.add_option("--flat", options.flat, "flat field, of any scale (FITS)");
  command
      .add_option("--flat-hdu", options.flat_hdu, "image of --flat to read, by EXTNAME or number")
      ->needs(flat);
  auto* bad = command.add_option("--bad-pixels", options.bad_pixels,
                                 "image that is not 0 where a pixel is bad (FITS)");
  command
      .add_option("--bad-pixels-hdu", options.bad_pixels_hdu,
                  "image of --bad-pixels to read, by EXTNAME or number")
      ->needs(bad);
  auto* picture = command.add_option("--picture", options.picture,
                                     "PNG to draw what was found into, window by window");
  make->excludes(reference)->excludes(camera)->excludes(dark)->excludes(bad)->excludes(picture);
  take_dark->excludes(dark)->excludes(flat)->excludes(bad)->excludes(picture);
}

/// Adds the options that describe optics and detector.
void add_numbers(CLI::App& command, CalibrateOptions& options) {
  command.add_option("--config", options.config,
                     "configuration (TOML): [centroid], and [camera] with --camera");
  command.add_option("--pitch-um", options.pitch_um, "lenslet pitch, µm");
  command.add_option("--focal-mm", options.focal_mm, "focal length of the lenslets, mm");
  command.add_option("--pixel-um", options.pixel_um, "pixel size, as binned, µm");
  command.add_option("--wavelength-nm", options.wavelength_nm, "wavelength, nm");
  command.add_option("--magnification", options.magnification,
                     "magnification of a relay between lenslets and detector (default 1)");
  command.add_flag("--mirror", options.mirror,
                   "say that the relay mirrors the image; flips charges");
  command.add_option("--e-per-adu", options.e_per_adu, "detector gain, electrons per ADU");
  command.add_option("--read-noise-e", options.read_noise_e, "read noise, electrons rms");
  command.add_option("--saturation-adu", options.saturation_adu,
                     "a pixel at or above this is saturated, ADU");
}

}  // namespace

void add_calibrate(CLI::App& app) {
  auto options = std::make_shared<CalibrateOptions>();
  CLI::App* command =
      app.add_subcommand("calibrate", "Find the lenslet grid and write the sensor file");
  add_files(*command, *options);
  add_numbers(*command, *options);
  command->callback([options] { calibrate(*options); });
}

}  // namespace curlew
