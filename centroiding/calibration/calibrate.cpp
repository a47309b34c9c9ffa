#include "centroiding/calibration/calibrate.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>

#include "centroiding/calibration/lenslet_grid_finder.h"
#include "centroiding/calibration/sentence.h"
#include "centroiding/calibration/spot_picture.h"
#include "centroiding/calibration/window_gain.h"
#include "core/error.h"

namespace curlew {
namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

template <typename T>
void check_size(const Image<T>& map, const Image<float>& reference, const char* name) {
  if (map.empty() || (map.rows() == reference.rows() && map.cols() == reference.cols())) return;
  throw Failure(say("the ", name, " is ", map.cols(), "×", map.rows(), " px but the reference is ",
                    reference.cols(), "×", reference.rows(), ": give files of one camera setting"));
}

/// Adopts the flat with mean 1 over good pixels. Its dead pixels join the bad ones.
void adopt_flat(Sensor& sensor, const CalibrationInput& input) {
  if (input.flat.empty()) return;
  sensor.flat = input.flat;
  double sum = 0.0;
  std::size_t n = 0;
  for (std::size_t i = 0; i < sensor.flat.size(); ++i) {
    const float response = sensor.flat[i];
    if (!std::isfinite(response) || response <= 0.0F) {
      if (sensor.bad_pixel.empty()) {
        sensor.bad_pixel = Image<std::uint8_t>(sensor.frame_rows, sensor.frame_cols, 0);
      }
      sensor.bad_pixel[i] = 1;
      sensor.flat[i] = 1.0F;
    } else if (sensor.bad_pixel.empty() || sensor.bad_pixel[i] == 0) {
      sum += static_cast<double>(response);
      ++n;
    }
  }
  if (n == 0) throw Failure("the flat has no pixel above 0: give a flat of an evenly lit detector");
  const auto mean = static_cast<float>(sum / static_cast<double>(n));
  for (float& response : sensor.flat) response /= mean;
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

/// Fills in read noise and gain where they were not given; `noise_adu` is the noise of one frame.
void complete_detector(Detector& detector, const CalibrationInput& input, double noise_adu,
                       std::vector<std::string>& notes) {
  if (std::isnan(detector.e_per_adu)) {
    detector.e_per_adu = 1.0;
    notes.emplace_back(
        "e- per ADU was not given and is taken as 1: variances from photon noise are a guess "
        "(--e-per-adu)");
  }
  if (std::isnan(detector.read_noise_e)) {
    if (!input.dark_variance_adu2.empty()) {
      std::vector<float> variances;
      for (const float v : input.dark_variance_adu2) {
        if (std::isfinite(v)) variances.push_back(v);
      }
      noise_adu = std::sqrt(quantile(std::move(variances), 0.5));
      notes.push_back(say("read noise ", noise_adu, " ADU, measured from the stack of darks"));
    } else {
      notes.push_back(say("read noise was not given and is estimated as ", noise_adu,
                          " ADU from the scatter between the spots (--read-noise-e)"));
    }
    detector.read_noise_e = noise_adu * detector.e_per_adu;
  }
}

/// Notes that the reference may be saturated: where many pixels hold exactly the largest value,
/// that value is the detector's end and not light.
void note_saturation(const CalibrationInput& input, std::vector<std::string>& notes) {
  if (!std::isnan(input.detector.saturation_adu)) return;
  float top = -std::numeric_limits<float>::max();
  int n = 0;
  for (const float v : input.reference_adu) {
    if (v > top) {
      top = v;
      n = 0;
    }
    n += v == top ? 1 : 0;
  }
  constexpr int kMany = 8;
  if (n >= kMany) {
    notes.push_back(say(n, " pixels of the reference hold its largest value, ", top,
                        " ADU: if that is saturation, expose less and give --saturation-adu"));
  }
}

/// Returns the side of the widest square window that leaves neighbours apart, whichever way the
/// grid is turned.
int window_side(const LensletGrid& grid) {
  constexpr double kTolerancePx = 0.1;  // A pitch of 6 may be fitted as 5.9998.
  const double apart = std::min(std::max(std::abs(grid.p11), std::abs(grid.p21)),
                                std::max(std::abs(grid.p12), std::abs(grid.p22)));
  return std::max(static_cast<int>(std::floor(apart + kTolerancePx)), 2);
}

/// Returns the window clipped to the frame. It is empty where less than half of it is left.
Window window_at(double x, double y, int side, int frame_cols, int frame_rows) {
  const auto first = [side](double centre) {
    return static_cast<int>(std::lround(centre - 0.5 * (side - 1)));
  };
  const int x0 = std::max(first(x), 0);
  const int y0 = std::max(first(y), 0);
  const int x1 = std::min(first(x) + side, frame_cols);
  const int y1 = std::min(first(y) + side, frame_rows);
  if (x1 <= x0 || y1 <= y0 || 2 * (x1 - x0) * (y1 - y0) < side * side) return {};
  return {x0, y0, x1 - x0, y1 - y0};
}

/// Takes away what [a0, a0+an) and [b0, b0+bn), of which a comes first, share beyond one pixel.
/// Both lose half of it.
void part(int& an, int& b0, int& bn, int shared) {
  const int excess = shared - 1;
  const int from_b = excess / 2;
  an -= excess - from_b;
  b0 += from_b;
  bn -= from_b;
}

/// Parts two windows that spots off the grid bring together, along the axis on which they share
/// less.
void part_windows(Window& a, Window& b) {
  if (a.w == 0 || b.w == 0) return;
  const int in_x = std::min(a.x0 + a.w, b.x0 + b.w) - std::max(a.x0, b.x0);
  const int in_y = std::min(a.y0 + a.h, b.y0 + b.h) - std::max(a.y0, b.y0);
  if (std::min(in_x, in_y) <= 1) return;
  if (in_x <= in_y) {
    Window& left = a.x0 <= b.x0 ? a : b;
    Window& right = a.x0 <= b.x0 ? b : a;
    part(left.w, right.x0, right.w, in_x);
  } else {
    Window& upper = a.y0 <= b.y0 ? a : b;
    Window& lower = a.y0 <= b.y0 ? b : a;
    part(upper.h, lower.y0, lower.h, in_y);
  }
}

void part_neighbours(Image<Window>& windows) {
  constexpr std::array<std::array<int, 2>, 4> kSteps{{{0, 1}, {1, -1}, {1, 0}, {1, 1}}};
  for (int r = 0; r < windows.rows(); ++r) {
    for (int c = 0; c < windows.cols(); ++c) {
      for (const auto& [dr, dc] : kSteps) {
        if (windows.contains(r + dr, c + dc)) part_windows(windows(r, c), windows(r + dr, c + dc));
      }
    }
  }
}

/// Sets the gains of all lenslets. A gain well below the others' belongs to a smear or to a spot
/// that the rim cuts, and this lenslet is dropped. Below kMinGain most of a displacement is lost,
/// and dividing by the gain would multiply noise.
void set_gains(Sensor& sensor, const std::vector<WindowMeasurement>& measured,
               const std::vector<WindowGain>& gains, std::vector<std::string>& notes) {
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
    const double x = std::clamp(gains[k].x, kMinGain, max_gain);
    const double y = std::clamp(gains[k].y, kMinGain, max_gain);
    sensor.gain_x[k] = static_cast<float>(x);
    sensor.gain_y[k] = static_cast<float>(y);
    n_held += x != gains[k].x || y != gains[k].y ? 1 : 0;
    n_unsure += m.gain_is_sure ? 0 : 1;
  }
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

/// Sets windows, first references, flux and gain of every lit lenslet.
void measure_spots(Sensor& sensor, const FoundGrid& found, const Image<float>& light,
                   const CentroidOptions& options, double reference_noise_adu,
                   std::vector<std::string>& notes) {
  const int rows = found.grid.rows;
  const int cols = found.grid.cols;
  const int side = window_side(found.grid);
  sensor.valid = found.lit;
  sensor.window = Image<Window>(rows, cols);
  for (auto* map :
       {&sensor.ref_x_px, &sensor.ref_y_px, &sensor.gain_x, &sensor.gain_y, &sensor.flux_adu}) {
    *map = Image<float>(rows, cols, kNaN);
  }
  for (std::size_t k = 0; k < found.lit.size(); ++k) {
    if (found.lit[k] == 0) continue;
    sensor.window[k] =
        window_at(static_cast<double>(found.spot_x_px[k]), static_cast<double>(found.spot_y_px[k]),
                  side, sensor.frame_cols, sensor.frame_rows);
  }
  part_neighbours(sensor.window);

  const double noise_adu = sensor.detector.read_noise_e / sensor.detector.e_per_adu;
  sensor.method = options.method;
  const SignalThreshold threshold =
      options.method == CentroidMethod::kPlain
          ? SignalThreshold{}
          : SignalThreshold{std::max(options.threshold_adu, options.threshold_noise * noise_adu),
                            options.threshold_relative};
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
  const WindowGains gains = find_window_gains(sensor, measured, threshold, options);
  sensor.spot_blur_px = gains.spot_blur_px;
  set_gains(sensor, measured, gains.gains, notes);
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
  sensor.dark_adu = input.dark_adu;
  sensor.bad_pixel = input.bad_pixel;
  adopt_flat(sensor, input);

  const Image<float> corrected = correct(input.reference_adu, sensor);
  const FoundGrid found = find_lenslet_grid(corrected, sensor.bad_pixel, input.optics.mirrored);
  sensor.grid = found.grid;
  sensor.residual_px = found.residual_px;
  if (input.dark_adu.empty()) {
    sensor.background_adu = found.background_adu;
    calibration.notes.push_back(say("no dark was given: a background of ", found.background_adu,
                                    " ADU, the median between the spots, is subtracted"));
  }
  complete_detector(sensor.detector, input, found.noise_adu * std::sqrt(input.reference_frames),
                    calibration.notes);
  note_saturation(input, calibration.notes);

  Image<float> light = corrected;
  for (float& value : light) value -= static_cast<float>(sensor.background_adu);
  fill_bad_pixels(light, sensor.bad_pixel, 0.0F);
  measure_spots(sensor, found, light, input.centroid, found.noise_adu, calibration.notes);
  return calibration;
}

}  // namespace curlew
