#include "centroiding/calibration/calibrate.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <limits>
#include <utility>

#include "centroiding/calibration/bad_pixel_search.h"
#include "centroiding/calibration/detector_estimate.h"
#include "centroiding/calibration/lenslet_grid_finder.h"
#include "centroiding/calibration/optics_check.h"
#include "centroiding/calibration/saturation_search.h"
#include "centroiding/calibration/sentence.h"
#include "centroiding/calibration/spot_blur.h"
#include "centroiding/calibration/spot_picture.h"
#include "centroiding/calibration/window_gain.h"
#include "centroiding/calibration/window_layout.h"
#include "centroiding/sampling_curve.h"
#include "core/error.h"

namespace curlew {
namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
constexpr double kCore = 0.1;  // the part of a spot's brightest pixel above which its core is

template <typename T>
void check_size(const Image<T>& map, const Image<float>& reference, const char* name) {
  if (map.empty() || (map.rows() == reference.rows() && map.cols() == reference.cols())) return;
  throw Failure(say("the ", name, " is ", map.cols(), "×", map.rows(), " px but the reference is ",
                    reference.cols(), "×", reference.rows(), ": give files of one camera setting"));
}

/// Adopts the flat with mean 1 over good pixels. Its dead pixels join the bad ones.
void adopt_flat(Sensor& sensor, const CalibrationInput& input, std::vector<std::string>& notes) {
  if (input.flat.empty()) return;
  sensor.flat = input.flat;
  const Image<std::uint8_t> dead = find_dead_pixels(input.flat);
  const auto n_dead = std::count(dead.begin(), dead.end(), std::uint8_t{1});
  if (n_dead > 0) {
    add_bad_pixels(sensor, dead);
    notes.push_back(say(n_dead, " pixels of the flat are dead, or far below their neighbours, and ",
                        "are taken as bad"));
  }
  double sum = 0.0;
  std::size_t n = 0;
  for (std::size_t i = 0; i < sensor.flat.size(); ++i) {
    if (dead[i] != 0) {
      sensor.flat[i] = 1.0F;
    } else if (sensor.bad_pixel.empty() || sensor.bad_pixel[i] == 0) {
      sum += static_cast<double>(sensor.flat[i]);
      ++n;
    }
  }
  if (n == 0) throw Failure("the flat has no pixel above 0: give a flat of an evenly lit detector");
  const auto mean = static_cast<float>(sum / static_cast<double>(n));
  for (std::size_t i = 0; i < sensor.flat.size(); ++i)
    if (dead[i] == 0) sensor.flat[i] /= mean;
}

/// Returns the reference as the kernel sees it: with the dark subtracted, and divided by the flat.
Image<float> correct(const Image<float>& reference, const Sensor& sensor) {
  Image<float> out = reference;
  for (std::size_t i = 0; i < out.size(); ++i) {
    if (!sensor.dark_adu.empty()) out[i] -= sensor.dark_adu[i];
    if (!sensor.flat.empty()) out[i] /= sensor.flat[i];
  }
  return out;
}

/// Adds what the reference shows to be no picture to the bad pixels: borders, and lone hot pixels.
/// Where every tenth spot has a hot pixel, spots are undersampled and it is they that are so sharp.
void adopt_found_bad_pixels(Sensor& sensor, const FoundGrid& found,
                            std::vector<std::string>& notes) {
  constexpr double kOnSpot = 0.25;  // pitches
  constexpr int kSpotsForOne = 10;
  if (!found.border.empty()) {
    add_bad_pixels(sensor, found.border);
    notes.push_back(say(std::count(found.border.begin(), found.border.end(), std::uint8_t{1}),
                        " pixels at the frame's rim hold no picture, as overscan does, and are ",
                        "taken as bad"));
  }
  int n_hot = 0;
  int n_on_spots = 0;
  for (int r = 0; r < found.hot.rows(); ++r) {
    for (int c = 0; c < found.hot.cols(); ++c) {
      if (found.hot(r, c) == 0) continue;
      ++n_hot;
      const auto [col, row] = found.grid.lenslet_from_pixel(c, r);
      const int i = static_cast<int>(std::lround(row));
      const int j = static_cast<int>(std::lround(col));
      if (!found.lit.contains(i, j) || found.lit(i, j) == 0) continue;
      const double distance = std::hypot(static_cast<double>(found.spot_x_px(i, j)) - c,
                                         static_cast<double>(found.spot_y_px(i, j)) - r);
      n_on_spots += distance < kOnSpot * found.grid.pitch_px() ? 1 : 0;
    }
  }
  if (n_hot == 0 || n_on_spots * kSpotsForOne > found.n_lit) return;
  add_bad_pixels(sensor, found.hot);
  notes.push_back(say(n_hot, " pixels of the reference are too sharp to be light through the ",
                      "optics, and are taken as bad"));
}

/// Returns the median over the spots of their brightest pixel.
double typical_peak(const Image<float>& image, const FoundGrid& found) {
  std::vector<float> peaks;
  for (std::size_t k = 0; k < found.lit.size(); ++k) {
    if (found.lit[k] == 0) continue;
    const int row = static_cast<int>(std::lround(found.spot_y_px[k]));
    const int col = static_cast<int>(std::lround(found.spot_x_px[k]));
    if (image.contains(row, col)) peaks.push_back(image(row, col));
  }
  return quantile(std::move(peaks), 0.5);
}

/// Returns the level to subtract from the corrected reference: that between the spots, lenslet by
/// lenslet where it is uneven and no dark tells it.
Image<float> find_level(const Image<float>& corrected, const Sensor& sensor, const FoundGrid& found,
                        bool dark_given, std::vector<std::string>& notes) {
  constexpr double kUnevenNoises = 10.0;
  constexpr double kUnevenOfSpots = 0.1;
  Image<float> level(corrected.rows(), corrected.cols(), static_cast<float>(sensor.background_adu));
  if (dark_given) return level;
  Image<float> filled = corrected;
  fill_bad_pixels(filled, sensor.bad_pixel, static_cast<float>(found.background_adu));
  Image<float> map = map_between_spots(filled, found.grid);
  // The wings of dense spots lift the level as well, but evenly, so only corners amid four spots
  // are compared.
  std::vector<float> values;
  for (int r = 0; r + 1 < found.grid.rows; ++r) {
    for (int c = 0; c + 1 < found.grid.cols; ++c) {
      if (found.lit(r, c) + found.lit(r, c + 1) + found.lit(r + 1, c) + found.lit(r + 1, c + 1) < 4)
        continue;
      const auto [x, y] = found.grid.pixel_from_lenslet(c + 0.5, r + 0.5);
      values.push_back(map(std::clamp(static_cast<int>(std::lround(y)), 0, map.rows() - 1),
                           std::clamp(static_cast<int>(std::lround(x)), 0, map.cols() - 1)));
    }
  }
  const double low = quantile(values, 0.1);
  const double high = quantile(std::move(values), 0.9);
  const double spots = typical_peak(corrected, found) - found.background_adu;
  if (high - low <= std::max(kUnevenNoises * found.noise_adu, kUnevenOfSpots * spots)) return level;
  notes.push_back(say("the level between the spots is uneven, from ", low, " to ", high,
                      " ADU: spots of the reference are measured over the level round them"));
  return map;
}

/// Sets the gains of all lenslets. A gain well below the others' belongs to a smear or to a spot
/// that the rim cuts, and this lenslet is dropped. Below kMinGain most of a displacement is lost,
/// and dividing by the gain would multiply noise.
void set_gains(Sensor& sensor, const std::vector<WindowMeasurement>& measured,
               const std::vector<WindowCurves>& curves, std::vector<std::string>& notes) {
  constexpr double kMinGain = 0.3;
  // A threshold lifts a gain only a little above 1. The threshold of the brightest pixels moves
  // with the spot and lifts it more.
  const double max_gain = is_centre_of_gravity(sensor.method) ? 1.2 : 2.0;
  constexpr double kMinOfTypical = 0.7;
  std::vector<float> sure;
  for (std::size_t k = 0; k < measured.size(); ++k) {
    if (sensor.valid[k] == 0 || !measured[k].gain_is_sure) continue;
    sure.push_back(static_cast<float>(measured[k].gain.x));
    sure.push_back(static_cast<float>(measured[k].gain.y));
  }
  const double typical = sure.empty() ? 1.0 : quantile(std::move(sure), 0.5);
  bool is_bent = false;
  int n_held = 0;
  int n_unsure = 0;
  int n_smeared = 0;
  for (std::size_t k = 0; k < measured.size(); ++k) {
    if (sensor.valid[k] == 0) continue;
    const WindowMeasurement& m = measured[k];
    if (m.gain_is_sure && std::min(m.gain.x, m.gain.y) < kMinOfTypical * typical) {
      drop_lenslet(sensor, k);
      ++n_smeared;
      continue;
    }
    const auto held = [&](const GainCurve& curve) -> GainCurve {
      const double gain = std::clamp(curve.gain, kMinGain, max_gain);
      return gain == curve.gain ? curve : GainCurve{.gain = gain};
    };
    const GainCurve x = held(curves[k].x);
    const GainCurve y = held(curves[k].y);
    sensor.gain_x[k] = static_cast<float>(x.gain);
    sensor.gain_y[k] = static_cast<float>(y.gain);
    sensor.bend2_x[k] = static_cast<float>(x.bend2);
    sensor.bend2_y[k] = static_cast<float>(y.bend2);
    sensor.bend3_x[k] = static_cast<float>(x.bend3);
    sensor.bend3_y[k] = static_cast<float>(y.bend3);
    is_bent = is_bent || x.is_bent() || y.is_bent();
    n_held += x.gain != curves[k].x.gain || y.gain != curves[k].y.gain ? 1 : 0;
    n_unsure += m.gain_is_sure ? 0 : 1;
  }
  if (!is_bent) sensor.bend2_x = sensor.bend2_y = sensor.bend3_x = sensor.bend3_y = {};
  if (n_smeared > 0) {
    notes.push_back(
        say(n_smeared, " lenslets were left out: their light is smeared over the ",
            "window's edge, as where the pupil's or the detector's rim cuts a lenslet"));
  }
  if (n_held > 0) {
    notes.push_back(say("the window gain of ", n_held, " lenslets was held within ", kMinGain,
                        " to ", max_gain, ": their light reaches the window's edge"));
  }
  if (n_unsure > 0) {
    notes.push_back(say("the window gain of ", n_unsure, " faint lenslets is that of a modelled ",
                        "spot: average more reference frames"));
  }
}

/// Returns Sensor::spot_sharpness; `light` is the reference above its background.
double measure_sharpness(const Sensor& sensor, const Image<float>& light) {
  std::vector<float> ratios;
  for (std::size_t k = 0; k < sensor.valid.size(); ++k) {
    if (sensor.valid[k] == 0) continue;
    const Window& window = sensor.window[k];
    int peak_x = 0;
    int peak_y = 0;
    float peak = 0.0F;
    for (int y = std::max(window.y0, 1); y < std::min(window.y0 + window.h, light.rows() - 1); ++y)
      for (int x = std::max(window.x0, 1); x < std::min(window.x0 + window.w, light.cols() - 1);
           ++x)
        if (light(y, x) > peak) peak = light(peak_y = y, peak_x = x);
    if (!(peak > 0.0F)) continue;
    std::array<float, 4> neighbours{light(peak_y, peak_x - 1), light(peak_y, peak_x + 1),
                                    light(peak_y - 1, peak_x), light(peak_y + 1, peak_x)};
    std::sort(neighbours.begin(), neighbours.end());
    if (neighbours[2] > 0.0F) ratios.push_back(peak / neighbours[2]);
  }
  if (ratios.empty()) return std::numeric_limits<double>::quiet_NaN();
  return static_cast<double>(quantile(std::move(ratios), 0.9));
}

/// Returns the typical spot's σ along an axis, px; NaN where there is none.
double typical_sigma_px(const Sensor& sensor, const std::vector<WindowMeasurement>& measured) {
  std::vector<float> spreads_px2;
  for (std::size_t k = 0; k < measured.size(); ++k)
    if (sensor.valid[k] != 0) spreads_px2.push_back(static_cast<float>(measured[k].spread_px2));
  return spreads_px2.empty() ? kUnknown : std::sqrt(0.5 * quantile(std::move(spreads_px2), 0.5));
}

/// Returns the spots' cores where spots have wings, and nothing else. Light that a mirror's or the
/// air's roughness scatters, or that the optics throw about, lies in other places on the sky than
/// on the lamp, and pulls a spot of the sky by up to half a pixel; it hardly reaches a tenth of the
/// peak. Spots have wings where all their light is twice as wide as diffraction makes it, and 1.8
/// times as wide as their cores.
std::vector<WindowMeasurement> adopt_cores(Sensor& sensor, const Image<float>& light,
                                           double min_adu, double noise_adu,
                                           double width_over_diffraction,
                                           std::vector<std::string>& notes) {
  constexpr double kWinged = 2.0;
  constexpr double kOverCore = 1.8;
  if (!(width_over_diffraction >= kWinged)) return {};
  std::vector<WindowMeasurement> cores(sensor.valid.size());
  for (std::size_t k = 0; k < cores.size(); ++k)
    if (sensor.valid[k] != 0)
      cores[k] =
          measure_window(light, sensor.bad_pixel, sensor.window[k], {min_adu, kCore}, noise_adu);
  if (!(sensor.spot_sigma_px >= kOverCore * typical_sigma_px(sensor, cores))) return {};
  sensor.core_threshold = kCore;
  for (std::size_t k = 0; k < cores.size(); ++k) {
    if (sensor.valid[k] == 0) continue;
    sensor.ref_x_px[k] = static_cast<float>(cores[k].x_px);
    sensor.ref_y_px[k] = static_cast<float>(cores[k].y_px);
  }
  notes.push_back(say("the spots have wings: with all light above the threshold they are ",
                      width_over_diffraction, " times as wide as diffraction; their positions are ",
                      "those of the light above ", kCore, " of each spot's brightest pixel"));
  return cores;
}

/// Returns what light counts in the reference, as the options say it of frames.
SignalThreshold reference_threshold(const CentroidOptions& options, double noise_adu) {
  if (options.method == CentroidMethod::kPlain) return {};
  return {std::max(options.threshold_adu, options.threshold_noise * noise_adu),
          options.threshold_relative};
}

/// Sets windows, first references, flux and gain of every lit lenslet. Returns how wide the typical
/// spot is over what diffraction makes it.
double measure_spots(Sensor& sensor, const FoundGrid& found, const Image<float>& light,
                     const CalibrationInput& input, double reference_noise_adu,
                     std::vector<std::string>& notes) {
  const CentroidOptions& options = input.centroid;
  const int rows = found.grid.rows;
  const int cols = found.grid.cols;
  sensor.valid = found.lit;
  sensor.window = lay_windows(found, sensor.frame_rows, sensor.frame_cols);
  for (const auto map : kLensletMaps) sensor.*map = Image<float>(rows, cols, kNaN);

  const double noise_adu = sensor.detector.read_noise_e / sensor.detector.e_per_adu;
  sensor.method = options.method;
  const SignalThreshold threshold = reference_threshold(options, noise_adu);
  std::vector<WindowMeasurement> measured(found.lit.size());
  int n_dropped = 0;
  for (std::size_t k = 0; k < found.lit.size(); ++k) {
    if (found.lit[k] == 0) continue;
    if (sensor.window[k].w > 0) {
      measured[k] =
          measure_window(light, sensor.bad_pixel, sensor.window[k], threshold, reference_noise_adu);
    }
    if (measured[k].flux_adu <= 0.0) {
      drop_lenslet(sensor, k);
      ++n_dropped;
      continue;
    }
    sensor.ref_x_px[k] = static_cast<float>(measured[k].x_px);
    sensor.ref_y_px[k] = static_cast<float>(measured[k].y_px);
    sensor.flux_adu[k] = static_cast<float>(measured[k].flux_adu);
  }
  if (n_dropped > 0) {
    notes.push_back(say(n_dropped, " spots at the rim were left out: less than half of the window ",
                        "is on the detector, or nothing in it exceeds the threshold"));
  }
  sensor.spot_sigma_px = typical_sigma_px(sensor, measured);
  sensor.spot_sharpness = measure_sharpness(sensor, light);
  sensor.spot_gaussian_px = fit_spot_gaussian_px(light, sensor);
  const ReferenceFrames reference{input.reference_frames, input.adu_per_count, input.light_is_cut};
  WindowGains gains = find_window_gains(sensor, light, measured, threshold, options, reference);
  const double width_over_diffraction = gains.width_over_diffraction;
  if (options.method == CentroidMethod::kThresholded && !(options.threshold_relative > 0.0)) {
    auto cores = adopt_cores(sensor, light, threshold.min_adu, reference_noise_adu,
                             width_over_diffraction, notes);
    if (!cores.empty()) {
      measured = std::move(cores);
      gains = find_window_gains(sensor, light, measured, {threshold.min_adu, kCore}, options,
                                reference);
    }
  }
  set_gains(sensor, measured, gains.curves, notes);
  const double blur_px = fit_spot_blur_px(sensor, light);
  sensor.spot_blur_px = std::isfinite(blur_px) ? blur_px : gains.spot_blur_px;
  return width_over_diffraction;
}

void append(std::vector<std::string>& notes, std::vector<std::string> more) {
  std::ranges::move(more, std::back_inserter(notes));
}

}  // namespace

Calibration calibrate_sensor(const CalibrationInput& input) {
  check_size(input.dark_adu, input.reference_adu, "dark");
  check_size(input.dark_variance_adu2, input.reference_adu, "dark's variance");
  check_size(input.flat, input.reference_adu, "flat");
  check_size(input.bad_pixel, input.reference_adu, "bad-pixel map");

  Calibration calibration;
  Sensor& sensor = calibration.sensor;
  sensor.optics = input.optics;
  sensor.detector = input.detector;
  sensor.frame_rows = input.reference_adu.rows();
  sensor.frame_cols = input.reference_adu.cols();
  sensor.offset_x_px = input.offset_x_px;
  sensor.offset_y_px = input.offset_y_px;
  sensor.binning = input.binning;
  sensor.pixel_bits = input.pixel_bits;
  sensor.dark_adu = input.dark_adu;
  sensor.bad_pixel = input.bad_pixel;
  adopt_flat(sensor, input, calibration.notes);

  const Image<float> corrected = correct(input.reference_adu, sensor);
  const FoundGrid found = find_lenslet_grid(corrected, sensor.bad_pixel, input.optics.mirrored);
  sensor.grid = found.grid;
  sensor.residual_px = found.residual_px;
  append(calibration.notes, check_pitch(sensor.optics, found.grid.pitch_px()));
  if (input.dark_adu.empty()) {
    sensor.background_adu = found.background_adu;
    calibration.notes.push_back(say("no dark was given: a background of ", found.background_adu,
                                    " ADU, the median between the spots, is subtracted"));
  }
  adopt_found_bad_pixels(sensor, found, calibration.notes);
  const Image<float> level =
      find_level(corrected, sensor, found, !input.dark_adu.empty(), calibration.notes);
  calibration.level_adu = quantile(std::vector<float>(level.begin(), level.end()), 0.5) -
                          (input.dark_adu.empty() ? sensor.background_adu : 0.0);
  Image<float> light = corrected;
  for (std::size_t i = 0; i < light.size(); ++i) light[i] -= level[i];
  sensor.detector = complete_detector(input, found, light, calibration.notes);
  find_saturation(sensor, input.reference_adu, found, calibration.notes);

  fill_bad_pixels(light, sensor.bad_pixel, 0.0F);
  calibration.width_over_diffraction =
      measure_spots(sensor, found, light, input, found.noise_adu, calibration.notes);
  refuse_saturated(sensor, input.reference_adu);
  append(calibration.notes, check_spot_width(sensor.optics, found.grid.pitch_px(),
                                             calibration.width_over_diffraction));
  return calibration;
}

}  // namespace curlew
