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
#include "service/sensor/reference_spots.h"
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

/// Returns the power of 2 of which all values of the first frame are multiples, as where a camera
/// writes 12 bits into the upper part of 16. It is 1 for 8 bits and for values that are not
/// integers.
int common_step(const std::string& path, const FrameSelection& selection) {
  FitsSource source({path}, selection);
  if (source.format().pixel_type != PixelType::kU16 || source.format().scale_adu != 1.0) return 1;
  FrameBuffer frame(source.format());
  if (source.next(frame) != Delivery::kFrame) return 1;
  const FrameView view = frame.view();
  const auto* pixels = view.data<std::uint16_t>();
  const auto n = static_cast<std::size_t>(view.rows) * static_cast<std::size_t>(view.cols);
  unsigned bits = 0;
  for (std::size_t i = 0; i < n; ++i) bits |= pixels[i];
  constexpr int kLeast = 4;  // Even numbers alone may be sums of two pixels.
  const int step = bits == 0 ? 1 : 1 << std::countr_zero(bits);
  return step >= kLeast ? step : 1;
}

CalibrationInput read_input(const CalibrateOptions& options, const FitsSource& source) {
  CalibrationInput input;
  const MeanImage reference = read_mean_image(options.reference, reference_selection(options));
  input.reference_adu = converted<float>(reference.mean);
  input.reference_frames = static_cast<int>(reference.frames);
  if (!reference.variance.empty())
    input.reference_variance_adu2 = converted<float>(reference.variance);
  input.adu_per_count = source.format().scale_adu;
  // Only simulated recordings tell the truth.
  input.light_is_cut = read_truth(options.reference).has_value();
  input.value_step = common_step(options.reference, reference_selection(options));
  if (!options.dark.empty()) {
    const MeanImage dark = read_map(options.dark, reference,
                                    {.hdu = options.dark_hdu, .content = ImageContent::kDark});
    check_dark(options.dark, dark);
    input.dark_adu = converted<float>(dark.mean);
    if (!dark.variance.empty()) input.dark_variance_adu2 = converted<float>(dark.variance);
  }
  if (!options.flat.empty())
    input.flat = converted<float>(
        read_map(options.flat, reference, {.hdu = options.flat_hdu, .content = ImageContent::kFlat})
            .mean);
  Image<std::uint8_t> bad(reference.region.rows, reference.region.cols);
  if (!options.bad_pixels.empty()) {
    const MeanImage map =
        read_map(options.bad_pixels, reference,
                 {.hdu = options.bad_pixels_hdu, .content = ImageContent::kBadPixels});
    for (std::size_t i = 0; i < bad.size(); ++i) bad[i] = map.mean[i] == 0.0 ? 0 : 1;
  }
  for (std::size_t i = 0; i < bad.size(); ++i)
    if (!std::isfinite(reference.mean[i])) bad[i] = 1;
  if (std::any_of(bad.begin(), bad.end(), [](std::uint8_t b) { return b != 0; }))
    input.bad_pixel = bad;
  input.optics = optics_of(options, source.optics());
  input.detector = detector_of(options, source.detector());
  input.offset_x_px = source.format().offset_x_px;
  input.offset_y_px = source.format().offset_y_px;
  input.binning = source.format().binning;
  // What 8 bits can hold may be frames of 8 bits that some program wrote as 16.
  constexpr double kLargestOf8Bits = 255.0;
  input.pixel_bits = converter_bits(source.format());
  if (std::none_of(reference.mean.begin(), reference.mean.end(),
                   [](double adu) { return adu > kLargestOf8Bits; }) &&
      input.pixel_bits == 16)
    input.pixel_bits = 0;
  return input;
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
  FitsSource source({options.reference}, reference_selection(options));
  CalibrationInput input = read_input(options, source);
  input.centroid = config.centroid;
  const auto calibrated = [&] {
    try {
      return calibrate_sensor(input);
    } catch (const Failure& failure) {
      throw Failure(options.reference + ": " + failure.what());
    }
  };
  Calibration calibration = calibrated();
  if (config.centroid.follow_level) {
    // Frames may need a higher threshold than their read noise says. Gains must be for that one.
    FitsSource frames({options.reference}, reference_selection(options));
    input.centroid.threshold_adu =
        std::max(input.centroid.threshold_adu,
                 find_frame_threshold_adu(frames, config.centroid, calibration.sensor) -
                     calibration.level_adu);
    calibration = calibrated();
  }
  Sensor& sensor = calibration.sensor;
  const ReferenceReport report = measure_reference_spots(source, config.centroid, sensor);
  write_sensor(options.out, sensor, provenance_of(options, config));
  print_fit(options, sensor);
  if (!options.picture.empty()) {
    write_sensor_picture(options.picture, sensor, input.reference_adu);
    fmt::print("  {}\n", sensor_picture_legend(options.picture));
  }
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
  if (!report.text.empty()) fmt::print("  {}\n", report.text);
  fmt::print("verdict on the sensor:\n");
  for (const std::string& line : sensor_verdict(sensor, calibration.width_over_diffraction))
    fmt::print("  {}\n", line);
}

/// Takes darks from the camera, and leaves no file where they are lit.
void take_dark(const CameraOptions& camera, const CalibrateOptions& options) {
  const std::string taken = partial_path(options.out + ".dark.fits");
  capture_frames(camera, options.frames, taken);
  try {
    check_dark(options.out, read_mean_image(taken));
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
