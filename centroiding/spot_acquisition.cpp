#include "centroiding/spot_acquisition.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <span>

#include "core/as_size.h"
#include "core/median.h"
#include "core/size_check.h"

namespace curlew {
namespace {

constexpr float kFarthest = 4.0F;  // What a quadratic gives beyond the lit cells may be anything.
constexpr float kTwoPi = 2.0F * std::numbers::pi_v<float>;

/// Returns the phase of z in pitches, from −.5 to .5, of a spot whose wave is exp(−2πi u).
float pitches_of(std::complex<float> z) noexcept { return -std::arg(z) / kTwoPi; }

float wrapped(float pitches) noexcept { return pitches - std::nearbyint(pitches); }

}  // namespace

SpotAcquisition::SpotAcquisition(const Sensor& sensor, const CentroidPlan& plan)
    : grid_(sensor.grid),
      side_(std::max(2, static_cast<int>(std::lround(sensor.grid.pitch_px())))),
      cells_(plan.spots.rows() + 2 * kMargin, plan.spots.cols() + 2 * kMargin),
      spot_(cells_.rows(), cells_.cols()),
      buffer_(cells_.size()) {
  const double determinant = grid_.determinant();
  const auto wave = [&](double per_px, int n, double origin) {
    std::vector<Complex> values(as_size(n));
    for (int i = 0; i < n; ++i) {
      const double phase = -2.0 * std::numbers::pi * per_px * (i - origin);
      values[as_size(i)] = {static_cast<float>(std::cos(phase)),
                            static_cast<float>(std::sin(phase))};
    }
    return values;
  };
  along_x_ = {.u = wave(grid_.p22 / determinant, plan.frame_cols, grid_.origin_x_px),
              .v = wave(-grid_.p21 / determinant, plan.frame_cols, grid_.origin_x_px)};
  along_y_ = {.u = wave(-grid_.p12 / determinant, plan.frame_rows, grid_.origin_y_px),
              .v = wave(grid_.p11 / determinant, plan.frame_rows, grid_.origin_y_px)};
}

template <typename Pixel>
float SpotAcquisition::Light<Pixel>::raised_of(int row, int col) const noexcept {
  return levels.level(std::clamp(row, 0, levels.level.rows() - 1),
                      std::clamp(col, 0, levels.level.cols() - 1)) +
         (levels.threshold - plan.threshold);
}

template <typename Pixel>
float SpotAcquisition::Light<Pixel>::at(std::size_t i, float count, float raised) const noexcept {
  const bool maps = !plan.gain.empty();
  const float gain = maps ? plan.gain[i] : 1.0F;
  const float offset = maps ? plan.offset[i] : plan.uniform_offset;
  return std::max(gain * count - (offset + raised), 0.0F);
}

/// Returns the light of a square of a pitch about (x, y), in counts; 0 where that lies far beyond
/// the frame. Sums the waves too if `moments` is not null. (row, col) is of the cell.
template <typename Pixel>
float SpotAcquisition::sum_light(const Light<Pixel>& light, int row, int col, double x_px,
                                 double y_px, Cell* moments) const noexcept {
  const int frame_cols = light.plan.frame_cols, frame_rows = light.plan.frame_rows;
  const auto first = [&](double centre) {
    return static_cast<int>(std::lround(centre - 0.5 * (side_ - 1)));
  };
  const double reach = 0.25 * side_;
  if (!(x_px > -reach && x_px < frame_cols - 1 + reach && y_px > -reach &&
        y_px < frame_rows - 1 + reach))
    return 0.0F;
  const int x0 = std::max(first(x_px), 0), x1 = std::min(first(x_px) + side_, frame_cols);
  const int y0 = std::max(first(y_px), 0), y1 = std::min(first(y_px) + side_, frame_rows);
  const float raised = light.raised_of(row, col);
  float all = 0.0F;
  for (int y = y0; y < y1; ++y) {
    float sum = 0.0F;
    Complex u, v;
    const std::size_t line = as_size(y) * as_size(frame_cols);
    for (int x = x0; x < x1; ++x) {
      const std::size_t i = line + as_size(x);
      const float signal = light.at(i, static_cast<float>(light.pixels[i]), raised);
      sum += signal;
      if (moments == nullptr) continue;
      u += signal * along_x_.u[as_size(x)];
      v += signal * along_x_.v[as_size(x)];
    }
    all += sum;
    if (moments == nullptr) continue;
    moments->u += u * along_y_.u[as_size(y)];
    moments->v += v * along_y_.v[as_size(y)];
  }
  return all;
}

/// Puts the light of sharp pixels' neighbours in place of their own.
template <typename Pixel>
void SpotAcquisition::replace_sharp_pixels(const Light<Pixel>& light,
                                           const SharpPixels& sharp) noexcept {
  const int cols = light.plan.frame_cols;
  const SharpPixel* last = nullptr;
  for (const SharpPixel& pixel : sharp.pixels) {
    if (last != nullptr && last->x == pixel.x && last->y == pixel.y) continue;
    last = &pixel;  // A pixel that two windows share is listed twice, one after the other.
    const auto [col, row] = grid_.lenslet_from_pixel(pixel.x, pixel.y);
    const int r = static_cast<int>(std::lround(row)), c = static_cast<int>(std::lround(col));
    if (!cells_.contains(r + kMargin, c + kMargin)) continue;
    Cell& cell = cells_(r + kMargin, c + kMargin);
    const std::size_t i = as_size(pixel.y) * as_size(cols) + as_size(pixel.x);
    const float raised = light.raised_of(r, c);
    const float excess = light.at(i, static_cast<float>(light.pixels[i]), raised) -
                         light.at(i, count_instead(light.pixels, cols, pixel), raised);
    const auto x = as_size(pixel.x), y = as_size(pixel.y);
    cell.light = std::max(cell.light - excess, 0.0F);
    cell.u -= excess * (along_x_.u[x] * along_y_.u[y]);
    cell.v -= excess * (along_x_.v[x] * along_y_.v[y]);
  }
}

/// Marks the cells with light: a tenth of what bright ones have, and more than noise. Returns
/// whether there are enough.
bool SpotAcquisition::mark_lit(float threshold) noexcept {
  constexpr float kOfBright = 0.1F;
  constexpr int kEnough = 4;
  for (std::size_t k = 0; k < cells_.size(); ++k) buffer_[k] = cells_[k].light;
  const auto dark = std::partition(buffer_.begin(), buffer_.end(),
                                   [&](float light) { return light > 2.0F * threshold; });
  const auto n = dark - buffer_.begin();
  if (n < kEnough) return false;
  const auto bright = buffer_.begin() + (4 * n) / 5;
  std::nth_element(buffer_.begin(), bright, dark);
  const float least = std::max(kOfBright * *bright, 2.0F * threshold);
  int lit = 0;
  for (Cell& cell : cells_) {
    cell.lit = cell.light > least;
    lit += cell.lit ? 1 : 0;
  }
  return lit >= kEnough;
}

/// Sets the linear part of the model: scale and rotation from neighbours, then the shift.
bool SpotAcquisition::fit_lattice() noexcept {
  constexpr float kLeastCoherence = 0.25F;  // Spots without order have far less.
  // How much a step along an axis changes u and v, from products of neighbours.
  struct Step {
    Complex u, v;
    float all_u = 0, all_v = 0;
    void add(const Cell& from, const Cell& to) noexcept {
      const Complex du = to.u * std::conj(from.u) / (to.light * from.light);
      const Complex dv = to.v * std::conj(from.v) / (to.light * from.light);
      u += du;
      v += dv;
      all_u += std::abs(du);
      all_v += std::abs(dv);
    }
    bool coherent() const noexcept {
      return std::abs(u) > kLeastCoherence * all_u && std::abs(v) > kLeastCoherence * all_v;
    }
  };
  Step along_col, along_row;
  for (int r = 0; r < cells_.rows(); ++r) {
    for (int c = 0; c < cells_.cols(); ++c) {
      if (!cells_(r, c).lit) continue;
      if (c + 1 < cells_.cols() && cells_(r, c + 1).lit)
        along_col.add(cells_(r, c), cells_(r, c + 1));
      if (r + 1 < cells_.rows() && cells_(r + 1, c).lit)
        along_row.add(cells_(r, c), cells_(r + 1, c));
    }
  }
  if (!along_col.coherent() || !along_row.coherent()) return false;
  const float u_col = pitches_of(along_col.u), v_col = pitches_of(along_col.v);
  const float u_row = pitches_of(along_row.u), v_row = pitches_of(along_row.v);

  const int rows = cells_.rows() - 2 * kMargin, cols = cells_.cols() - 2 * kMargin;
  const float mid_r = 0.5F * static_cast<float>(rows - 1);
  const float mid_c = 0.5F * static_cast<float>(cols - 1);
  Step shift;
  for (int r = 0; r < cells_.rows(); ++r) {
    for (int c = 0; c < cells_.cols(); ++c) {
      const Cell& cell = cells_(r, c);
      if (!cell.lit) continue;
      const float x = static_cast<float>(c - kMargin) - mid_c;
      const float y = static_cast<float>(r - kMargin) - mid_r;
      const Complex u =
          cell.u / cell.light * std::polar(1.0F, kTwoPi * wrapped(u_col * x + u_row * y));
      const Complex v =
          cell.v / cell.light * std::polar(1.0F, kTwoPi * wrapped(v_col * x + v_row * y));
      shift.u += u;
      shift.v += v;
      shift.all_u += std::abs(u);
      shift.all_v += std::abs(v);
    }
  }
  if (!shift.coherent()) return false;
  phase_ = {};
  phase_.x = {pitches_of(shift.u), u_col * mid_c, u_row * mid_r};
  phase_.y = {pitches_of(shift.v), v_col * mid_c, v_row * mid_r};
  return true;
}

/// Adds quadratic terms, from the cells whose phases lie near the model. Returns whether enough of
/// them do, and lie near enough.
bool SpotAcquisition::fit_quadratic() noexcept {
  constexpr std::array<float, 5> kNear{0.35F, 0.35F, 0.3F, 0.25F, 0.25F};  // pitches
  constexpr float kLeastKept = 0.45F;  // A fifth of random phases lies as near.
  constexpr float kMoreOfFew = 2.0F;
  constexpr float kLargestResidual = 0.17F;  // pitches, rms along an axis
  const int rows = cells_.rows() - 2 * kMargin, cols = cells_.cols() - 2 * kMargin;
  int lit = 0;
  int kept = 0;
  double square = 0.0;
  for (const float near : kNear) {
    LowOrdersFit fit;
    lit = kept = 0;
    square = 0.0;
    for (int r = 0; r < cells_.rows(); ++r) {
      const float v = model_coordinate(static_cast<float>(r - kMargin), rows);
      for (int c = 0; c < cells_.cols(); ++c) {
        const Cell& cell = cells_(r, c);
        if (!cell.lit) continue;
        ++lit;
        const float u = model_coordinate(static_cast<float>(c - kMargin), cols);
        const auto [at_u, at_v] = phase_.at(u, v);
        const float du = wrapped(pitches_of(cell.u) - at_u);
        const float dv = wrapped(pitches_of(cell.v) - at_v);
        const float distance2 = du * du + dv * dv;
        if (distance2 > near * near) continue;
        ++kept;
        square += 0.5 * static_cast<double>(distance2);
        fit.add(u, v, du, dv);
      }
    }
    phase_ += fit.solve();
  }
  return static_cast<float>(kept) >= kLeastKept * static_cast<float>(lit) + kMoreOfFew &&
         square <= static_cast<double>(kept) * static_cast<double>(kLargestResidual) *
                       static_cast<double>(kLargestResidual);
}

/// Returns how far the spot that lies by a node of the lattice lies from it, in pitches. Its phase
/// is that of the place where it is.
SpotAcquisition::Place SpotAcquisition::fraction(int row, int col) const noexcept {
  const int rows = cells_.rows() - 2 * kMargin, cols = cells_.cols() - 2 * kMargin;
  Place at;
  for (int i = 0; i < 3; ++i) {
    const auto [u, v] = phase_.at(model_coordinate(static_cast<float>(col) + at.u, cols),
                                  model_coordinate(static_cast<float>(row) + at.v, rows));
    at = {std::clamp(u, -kFarthest, kFarthest), std::clamp(v, -kFarthest, kFarthest)};
  }
  return at;
}

/// Chooses whole pitches and turns the model into px.
AcquisitionResult SpotAcquisition::choose_pitches(const SpotHistory& history,
                                                  LowOrders& model) const noexcept {
  // Rims are uncertain by a few lenslets; a step of a pitch changes whole sides.
  constexpr float kOfSide = 0.3F;
  constexpr float kClearly = 0.15F;  // pitches
  const int rows = history.lit.rows(), cols = history.lit.cols();
  constexpr int kSteps = 2 * kMargin + 1;
  std::array<int, as_size(kSteps) * as_size(kSteps)> overlap{};
  int n_lit = 0;
  Place mean;
  for (int r = 0; r < rows; ++r) {
    for (int c = 0; c < cols; ++c) {
      if (history.lit(r, c) == 0) continue;
      ++n_lit;
      const Place at = fraction(r, c);
      mean.u += at.u;
      mean.v += at.v;
      for (int i = 0; i < kSteps; ++i)
        for (int j = 0; j < kSteps; ++j)
          overlap[as_size(i * kSteps + j)] += spot_(r + i, c + j) != 0 ? 1 : 0;
    }
  }
  if (n_lit == 0) return AcquisitionResult::kNoLight;
  mean.u /= static_cast<float>(n_lit);
  mean.v /= static_cast<float>(n_lit);
  const int most = *std::max_element(overlap.begin(), overlap.end());
  const float slack = std::max(1.5F, kOfSide * std::sqrt(static_cast<float>(n_lit)));

  const double determinant = grid_.determinant();
  const auto last_u = static_cast<float>((grid_.p22 * static_cast<double>(history.mean_px[0]) -
                                          grid_.p12 * static_cast<double>(history.mean_px[1])) /
                                         determinant);
  const auto last_v = static_cast<float>((grid_.p11 * static_cast<double>(history.mean_px[1]) -
                                          grid_.p21 * static_cast<double>(history.mean_px[0])) /
                                         determinant);
  float nearest = std::numeric_limits<float>::infinity(), second = nearest;
  int pitch_u = 0, pitch_v = 0;
  for (int i = -kMargin; i <= kMargin; ++i) {
    for (int j = -kMargin; j <= kMargin; ++j) {
      const int n = overlap[as_size((i + kMargin) * kSteps + j + kMargin)];
      if (static_cast<float>(most - n) > slack) continue;
      const float step = std::hypot(mean.u + static_cast<float>(j) - last_u,
                                    mean.v + static_cast<float>(i) - last_v);
      if (step < nearest) {
        second = nearest;
        nearest = step;
        pitch_u = j;
        pitch_v = i;
      } else {
        second = std::min(second, step);
      }
    }
  }
  if (second - nearest < kClearly) return AcquisitionResult::kUndecidable;

  LowOrdersFit fit;
  const int stride = 1 + n_lit / 512;
  int seen = 0;
  for (int r = 0; r < rows; ++r) {
    for (int c = 0; c < cols; ++c) {
      if (history.lit(r, c) == 0 || seen++ % stride != 0) continue;
      const Place at = fraction(r + pitch_v, c + pitch_u);
      const auto u = static_cast<double>(at.u) + pitch_u, v = static_cast<double>(at.v) + pitch_v;
      fit.add(model_coordinate(static_cast<float>(c), cols),
              model_coordinate(static_cast<float>(r), rows),
              static_cast<float>(grid_.p11 * u + grid_.p12 * v),
              static_cast<float>(grid_.p21 * u + grid_.p22 * v));
    }
  }
  model = fit.solve();
  return AcquisitionResult::kFound;
}

template <typename Pixel>
AcquisitionResult SpotAcquisition::find_in(const Light<Pixel>& light, const SharpPixels& sharp,
                                           const SpotHistory& history, LowOrders& model) noexcept {
  constexpr float kOfTypical = 0.3F;
  for (int r = 0; r < cells_.rows(); ++r) {
    for (int c = 0; c < cells_.cols(); ++c) {
      Cell& cell = cells_(r, c);
      cell = {};
      const auto [x, y] = grid_.pixel_from_lenslet(c - kMargin, r - kMargin);
      cell.light = sum_light(light, r - kMargin, c - kMargin, x, y, &cell);
    }
  }
  replace_sharp_pixels(light, sharp);
  if (!mark_lit(light.levels.threshold)) return AcquisitionResult::kNoLight;
  if (!fit_lattice() || !fit_quadratic()) return AcquisitionResult::kNoGrid;

  std::size_t n = 0;
  for (int r = 0; r < cells_.rows(); ++r) {
    for (int c = 0; c < cells_.cols(); ++c) {
      const Place at = fraction(r - kMargin, c - kMargin);
      const auto [x, y] = grid_.pixel_from_lenslet(c - kMargin + static_cast<double>(at.u),
                                                   r - kMargin + static_cast<double>(at.v));
      Cell& cell = cells_(r, c);
      cell.light = sum_light(light, r - kMargin, c - kMargin, x, y, nullptr);
      if (cell.lit) buffer_[n++] = cell.light;
    }
  }
  const float typical = median_of(std::span(buffer_.data(), n));
  for (std::size_t k = 0; k < cells_.size(); ++k)
    spot_[k] = cells_[k].light > kOfTypical * typical ? 1 : 0;
  return choose_pitches(history, model);
}

AcquisitionResult SpotAcquisition::find(const CentroidPlan& plan, FrameView frame,
                                        const FrameConditions& conditions,
                                        const SpotHistory& history, LowOrders& model) noexcept {
  check_size("SpotAcquisition", "a frame", {frame.rows, frame.cols},
             {plan.frame_rows, plan.frame_cols});
  check_size("SpotAcquisition", "lenslets", size_of(history.lit), size_of(plan.spots));
  const FrameLevels& levels = *conditions.levels;
  return frame.pixel_type == PixelType::kU16
             ? find_in(Light<std::uint16_t>{plan, frame.data<std::uint16_t>(), levels},
                       *conditions.sharp, history, model)
             : find_in(Light<std::uint8_t>{plan, frame.data<std::uint8_t>(), levels},
                       *conditions.sharp, history, model);
}

}  // namespace curlew
