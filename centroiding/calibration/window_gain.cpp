#include "centroiding/calibration/window_gain.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>
#include <utility>

#include "centroiding/calibration/optics_check.h"

namespace curlew {
namespace {

/// Returns the view of a lenslet's spot for the model, as bright as it was measured.
SpotView view_of(const SpotModel& model, const Window& window, const WindowMeasurement& m,
                 const SignalThreshold& threshold) {
  SpotView view{.window = window,
                .x_px = m.x_px,
                .y_px = m.y_px,
                .threshold_adu = threshold.min_adu,
                .threshold_relative = threshold.relative};
  view.total_adu = model.total_for_flux(view, m.flux_adu);
  return view;
}

/// This is what the typical spot tells, the one of median spread.
struct SpotWidth {
  double blur_px = 0.0;  ///< σ that widens the model to it; 0 where diffraction is as wide
  double over_diffraction = kUnknown;
};

/// Halves [low, high] until the lengths that make the model too narrow end there.
template <typename TooNarrow>
double widest_too_narrow(double low, double high, TooNarrow is_too_narrow) {
  constexpr int kHalvings = 16;
  for (int i = 0; i < kHalvings; ++i) {
    const double middle = 0.5 * (low + high);
    (is_too_narrow(middle) ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

SpotWidth fit_width(const Sensor& sensor, const std::vector<WindowMeasurement>& measured,
                    double model_diffraction_px, const SignalThreshold& threshold) {
  std::vector<std::size_t> lit;
  for (std::size_t k = 0; k < measured.size(); ++k) {
    if (sensor.valid[k] != 0) lit.push_back(k);
  }
  if (lit.empty()) return {};
  const auto median = lit.begin() + static_cast<std::ptrdiff_t>(lit.size() / 2);
  std::nth_element(lit.begin(), median, lit.end(), [&](std::size_t a, std::size_t b) {
    return measured[a].spread_px2 < measured[b].spread_px2;
  });
  const Window& window = sensor.window[*median];
  const WindowMeasurement& typical = measured[*median];
  const auto is_too_narrow = [&](double d_px, double blur_px) {
    const SpotModel model(d_px, blur_px);
    return model.moments(view_of(model, window, typical, threshold)).spread_px2 <
           typical.spread_px2;
  };
  const double most = 0.5 * std::max(window.w, window.h);
  const auto blur_of = [&](double d_px) {
    if (!is_too_narrow(d_px, 0.0)) return 0.0;
    return widest_too_narrow(0.0, most, [&](double blur) { return is_too_narrow(d_px, blur); });
  };
  SpotWidth width{.blur_px = blur_of(model_diffraction_px)};
  const double d_px = diffraction_px(sensor.optics, sensor.grid.pitch_px());
  if (!(d_px > 0.0)) return width;
  constexpr double kSigma = 0.42;  // of the Gaussian most like a spot, in units of d
  constexpr double kNarrowest = 0.05;
  const double blur = blur_of(d_px);
  width.over_diffraction = blur > 0.0 ? std::hypot(blur / (kSigma * d_px), 1.0)
                                      : widest_too_narrow(kNarrowest, 1.0, [&](double part) {
                                          return is_too_narrow(part * d_px, 0.0);
                                        });
  return width;
}

/// Returns the gains of the kernel on the modelled spot without noise. The spot is moved to four
/// sides, and the four pictures lie one beside the other in a frame.
WindowCurves gains_of_kernel(const Sensor& sensor, CentroidOptions options, const SpotModel& model,
                             const SpotView& view) {
  constexpr double kShiftPx = 0.25;
  constexpr double kPeakCounts = 60000.0;
  constexpr int kMoves = 4;
  constexpr std::array<std::array<double, 2>, kMoves> kShifts = {
      {{kShiftPx, 0.0}, {-kShiftPx, 0.0}, {0.0, kShiftPx}, {0.0, -kShiftPx}}};
  const Window& window = view.window;
  Sensor row;
  row.optics = sensor.optics;
  row.detector = sensor.detector;
  row.detector.saturation_adu = kUnknown;
  row.frame_rows = window.h;
  row.frame_cols = std::max(kMoves * window.w, 4);
  row.method = options.method;
  row.valid = Image<std::uint8_t>(1, kMoves, 1);
  row.window = Image<Window>(1, kMoves);
  row.ref_x_px = row.ref_y_px = Image<float>(1, kMoves);
  Image<float> light(row.frame_rows, row.frame_cols);
  for (int i = 0; i < kMoves; ++i) {
    row.window(0, i) = {i * window.w, 0, window.w, window.h};
    row.ref_x_px(0, i) = static_cast<float>(i * window.w + view.x_px - window.x0);
    row.ref_y_px(0, i) = static_cast<float>(view.y_px - window.y0);
    const auto& shift = kShifts[static_cast<std::size_t>(i)];
    SpotView moved = view;
    moved.x_px += shift[0];
    moved.y_px += shift[1];
    const Image<float> picture = model.picture(moved);
    for (int r = 0; r < window.h; ++r) {
      for (int c = 0; c < window.w; ++c) light(r, i * window.w + c) = picture(r, c);
    }
  }
  const auto peak = static_cast<double>(*std::max_element(light.begin(), light.end()));
  FrameFormat format;
  format.rows = row.frame_rows;
  format.cols = row.frame_cols;
  format.scale_adu = peak > 0.0 ? peak / kPeakCounts : 1.0;
  Image<std::uint16_t> counts(format.rows, format.cols);
  for (std::size_t i = 0; i < counts.size(); ++i) {
    counts[i] = static_cast<std::uint16_t>(
        std::lround(std::max(static_cast<double>(light[i]) / format.scale_adu, 0.0)));
  }
  options.min_snr = 0.0;
  options.edge_fraction = 0.0;
  Centroids centroids(1, kMoves);
  find_centroids(CentroidPlan(row, format, options),
                 {reinterpret_cast<const std::byte*>(counts.data()), format.rows, format.cols,
                  PixelType::kU16},
                 centroids);
  if (centroids.n_valid < kMoves) return {};
  const auto apart = [](float a, float b) { return static_cast<double>(a - b); };
  return {
      .x = {.gain = (apart(centroids.x_px[0], centroids.x_px[1]) + window.w) / (2.0 * kShiftPx)},
      .y = {.gain = apart(centroids.y_px[2], centroids.y_px[3]) / (2.0 * kShiftPx)}};
}

/// Returns the weights of the pixels −2…3 px from one for the value `part` px behind it (0 to 1),
/// after Lagrange. They are exact for polynomials up to the fifth degree, so that a picture moves
/// by what it is told to.
std::array<double, 6> lagrange_weights(double part) {
  std::array<double, 6> weights{};
  for (int i = 0; i < 6; ++i) {
    double weight = 1.0;
    for (int k = 0; k < 6; ++k) {
      if (k != i) weight *= (part - (k - 2)) / (i - k);
    }
    weights[static_cast<std::size_t>(i)] = weight;
  }
  return weights;
}

constexpr int kPlaces = 9;  // at which a curve is looked at

/// Returns place i of a range's.
double place_in(const SpotRange& range, int i) {
  return range.low_px + (range.high_px - range.low_px) * i / (kPlaces - 1);
}

/// These are the measured displacements at the places of a range.
using Measured = Eigen::Matrix<double, kPlaces, 1>;

/// Returns the cubic through the reference that tells the places from what was measured of them
/// best, in the sense of least squares. It is a line of the gain where a line is nowhere wrong by
/// more than range.straight_px, or where no cubic rises steadily.
GainCurve fit_curve(const SpotRange& range, const Measured& q, double gain) {
  if (!q.allFinite()) return {.gain = kUnknown, .line_gain = kUnknown};
  Measured places;
  for (int i = 0; i < kPlaces; ++i) places[i] = place_in(range, i);
  const double best_line = q.dot(places) / q.squaredNorm();
  if ((q * best_line - places).cwiseAbs().maxCoeff() <= range.straight_px)
    return {.gain = gain, .line_gain = gain};
  Eigen::Matrix<double, kPlaces, 3> powers;
  powers << q, q.cwiseAbs2(), q.cwiseProduct(q.cwiseAbs2());
  const Eigen::Vector3d cubic = powers.colPivHouseholderQr().solve(places);
  const auto rises = [&](double at) {
    return cubic[0] + 2.0 * cubic[1] * at + 3.0 * cubic[2] * at * at > 0.0;
  };
  if (!rises(0.0) || !std::all_of(q.begin(), q.end(), rises))
    return {.gain = gain, .line_gain = gain};
  return {1.0 / cubic[0], cubic[1], cubic[2], gain};
}

/// Returns the window's pixels [h, w] of the picture moved by (dx, dy) px, of which one at least
/// is 0.
/// Beyond the frame its outermost pixels go on.
Image<float> move_picture(const Image<float>& light, const Window& window, double dx, double dy) {
  const bool along_x = dx != 0.0;
  const double from = along_x ? -dx : -dy;
  const int first = static_cast<int>(std::floor(from));
  const std::array<double, 6> weights = lagrange_weights(from - first);
  Image<float> moved(window.h, window.w);
  for (int r = 0; r < window.h; ++r) {
    for (int c = 0; c < window.w; ++c) {
      double sum = 0.0;
      for (int i = 0; i < 6; ++i) {
        const int step = first + i - 2;
        const int row = std::clamp(window.y0 + r + (along_x ? 0 : step), 0, light.rows() - 1);
        const int col = std::clamp(window.x0 + c + (along_x ? step : 0), 0, light.cols() - 1);
        sum += weights[static_cast<std::size_t>(i)] * static_cast<double>(light(row, col));
      }
      moved(r, c) = static_cast<float>(sum);
    }
  }
  return moved;
}

}  // namespace

WindowMeasurement measure_window(const Image<float>& light, const Image<std::uint8_t>& bad,
                                 const Window& window, const SignalThreshold& threshold,
                                 double noise_adu) {
  constexpr double kMaxSigma = 0.1;
  const int x1 = window.x0 + window.w - 1;
  const int y1 = window.y0 + window.h - 1;
  const auto for_each_pixel = [&](auto visit) {
    for (int r = window.y0; r <= y1; ++r) {
      for (int c = window.x0; c <= x1; ++c) {
        if (bad.empty() || bad(r, c) == 0) visit(r, c, static_cast<double>(light(r, c)));
      }
    }
  };
  double peak = 0.0;
  for_each_pixel([&](int, int, double value) { peak = std::max(peak, value); });
  const double minimum = std::max(threshold.min_adu, threshold.relative * peak);

  WindowMeasurement m;
  for_each_pixel([&](int r, int c, double value) {
    const double f = std::max(value - minimum, 0.0);
    m.flux_adu += f;
    m.x_px += f * c;
    m.y_px += f * r;
  });
  if (m.flux_adu <= 0.0) return m;
  m.x_px /= m.flux_adu;
  m.y_px /= m.flux_adu;
  double lost_x = 0.0;
  double lost_y = 0.0;
  for_each_pixel([&](int r, int c, double value) {
    const double f = std::max(value - minimum, 0.0);
    m.spread_px2 += f * ((c - m.x_px) * (c - m.x_px) + (r - m.y_px) * (r - m.y_px));
    if (c == window.x0) lost_x += f * (m.x_px - (c - 0.5));
    if (c == x1) lost_x += f * (c + 0.5 - m.x_px);
    if (r == window.y0) lost_y += f * (m.y_px - (r - 0.5));
    if (r == y1) lost_y += f * (r + 0.5 - m.y_px);
  });
  m.spread_px2 /= m.flux_adu;
  m.gain = {1.0 - lost_x / m.flux_adu, 1.0 - lost_y / m.flux_adu};
  // Noise enters from two edges of `length` pixels with lever arms of half the `width`.
  const auto sigma = [&](int length, int width) {
    return noise_adu * width * std::sqrt(0.5 * length) / m.flux_adu;
  };
  m.gain_is_sure = std::max(sigma(window.h, window.w), sigma(window.w, window.h)) <= kMaxSigma;
  return m;
}

WindowCurves curves_of_picture(const Image<float>& light, const Window& window,
                               const SignalThreshold& threshold, const PictureNoise& noise,
                               const SpotRange& along_x, const SpotRange& along_y) {
  // Within half a pixel a line and a cubic have the same mean slope as between these two points.
  constexpr double kShiftPx = 0.387;
  // The picture's own noise lifts pixels over the threshold as it is; what frames have beyond it
  // is averaged over.
  const double left = std::max(1.0 - 1.0 / noise.frames, 0.0);
  const double rest_adu = noise.frame_adu * std::sqrt(left);
  const auto centre = [&](double dx, double dy) {
    const Image<float> moved = move_picture(light, window, dx, dy);
    double peak = 0.0;
    for (const float value : moved) peak = std::max(peak, static_cast<double>(value));
    const double minimum = std::max(threshold.min_adu, threshold.relative * peak);
    double sum = 0.0;
    std::array<double, 2> at{};
    for (int r = 0; r < window.h; ++r) {
      for (int c = 0; c < window.w; ++c) {
        const double signal = mean_signal(static_cast<double>(moved(r, c)), minimum, rest_adu,
                                          noise.adu_per_e * left);
        sum += signal;
        at[0] += signal * c;
        at[1] += signal * r;
      }
    }
    if (sum <= 0.0) return std::array<double, 2>{kUnknown, kUnknown};
    return std::array<double, 2>{at[0] / sum, at[1] / sum};
  };
  const std::array<double, 2> still = centre(0.0, 0.0);
  Measured x;
  Measured y;
  for (int i = 0; i < kPlaces; ++i) {
    x[i] = centre(place_in(along_x, i), 0.0)[0] - still[0];
    y[i] = centre(0.0, place_in(along_y, i))[1] - still[1];
  }
  const double gain_x = centre(kShiftPx, 0.0)[0] - centre(-kShiftPx, 0.0)[0];
  const double gain_y = centre(0.0, kShiftPx)[1] - centre(0.0, -kShiftPx)[1];
  return {fit_curve(along_x, x, gain_x / (2.0 * kShiftPx)),
          fit_curve(along_y, y, gain_y / (2.0 * kShiftPx))};
}

SpotRange range_of_spots(double off_px, double reach_px) {
  // Few spots lie at the end of their reach. A cubic that is fitted up to there is wrong by 1 % at
  // small displacements of the narrowest spots; this one by .2 %, and at the end by .007 px.
  constexpr double kFitted = 0.9;
  return {-kFitted * reach_px - off_px, kFitted * reach_px - off_px};
}

namespace {

/// Makes lines of all curves unless half of them are bent.
void straighten_unless_bent(std::vector<WindowCurves>& curves, const Image<std::uint8_t>& valid) {
  int n_bent = 0;
  int n_valid = 0;
  for (std::size_t k = 0; k < curves.size(); ++k) {
    n_bent += curves[k].x.is_bent() || curves[k].y.is_bent() ? 1 : 0;
    n_valid += valid[k] != 0 ? 1 : 0;
  }
  if (2 * n_bent >= n_valid) return;
  for (WindowCurves& curve : curves)
    for (GainCurve* axis : {&curve.x, &curve.y})
      if (axis->is_bent()) *axis = {.gain = axis->line_gain};
}

}  // namespace

WindowGains find_window_gains(const Sensor& sensor, const Image<float>& light,
                              const std::vector<WindowMeasurement>& measured,
                              const SignalThreshold& threshold, const CentroidOptions& options,
                              const ReferenceFrames& reference) {
  const double model_px = 2.0 * std::numbers::pi / sensor.optics.slope_rad_per_px();
  const SpotWidth width = fit_width(sensor, measured, model_px, threshold);
  const SpotModel model(model_px, width.blur_px);
  const double adu_per_e = 1.0 / sensor.detector.e_per_adu;
  // The last term is the noise of rounding.
  const double noise_adu = std::hypot(sensor.detector.read_noise_e * adu_per_e,
                                      reference.adu_per_count * std::sqrt(1.0 / 12.0));
  // A spot as wide as its window hardly moves in it.
  constexpr double kMinOnModel = 0.1;
  // These are the second moments, x and y together, of the narrowest spot to be interpolated, and
  // the σ of its core, which may be much narrower than its wings tell; then lines are taken.
  constexpr double kWellSampledPx2 = 1.6;
  constexpr double kWellSampledCorePx = 0.9;
  const bool is_sharp = sensor.spot_gaussian_px < kWellSampledCorePx;
  const double reach_px = curve_reach_px(sensor);
  std::vector<WindowCurves> curves(measured.size());
  for (std::size_t k = 0; k < measured.size(); ++k) {
    if (sensor.valid[k] == 0) continue;
    const Window& window = sensor.window[k];
    const bool gravity = is_centre_of_gravity(options.method);
    if (gravity && !reference.light_is_cut && measured[k].gain_is_sure &&
        measured[k].spread_px2 >= kWellSampledPx2) {
      const auto range = [&](double at_px, int start, int length) {
        SpotRange spots = range_of_spots(off_middle_px(at_px, start, length), reach_px);
        if (is_sharp) spots.straight_px = std::numeric_limits<double>::infinity();
        return spots;
      };
      curves[k] =
          curves_of_picture(light, window, threshold, {noise_adu, adu_per_e, reference.frames},
                            range(measured[k].x_px, window.x0, window.w),
                            range(measured[k].y_px, window.y0, window.h));
      if (std::isfinite(curves[k].x.gain) && std::isfinite(curves[k].y.gain)) continue;
    }
    SpotView view = view_of(model, window, measured[k], threshold);
    const WindowGain measured_on_model =
        measure_window(model.picture(view), {}, {0, 0, window.w, window.h}, threshold, 0.0).gain;
    view.noise_adu = noise_adu;
    view.adu_per_e = adu_per_e;
    if (!gravity) {
      curves[k] = gains_of_kernel(sensor, options, model, view);
      continue;
    }
    WindowGain gain = model.window_gain(view);
    if (measured[k].gain_is_sure) {
      gain.x *= measured[k].gain.x / std::max(measured_on_model.x, kMinOnModel);
      gain.y *= measured[k].gain.y / std::max(measured_on_model.y, kMinOnModel);
    }
    curves[k] = {.x = {.gain = gain.x}, .y = {.gain = gain.y}};
  }
  straighten_unless_bent(curves, sensor.valid);
  return {std::move(curves), width.over_diffraction, width.blur_px};
}

}  // namespace curlew
