#include "service/air/air_meter.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

#include "centroiding/window_light.h"
#include "service/frame_time.h"

namespace curlew {
namespace {

Image<std::uint8_t> lit_lenslets(const Lattice& lattice) {
  Image<std::uint8_t> lit(lattice.rows(), lattice.cols());
  for (std::size_t k = 0; k < lit.size(); ++k)
    lit[k] = lattice.phase_group_of(static_cast<int>(k)) >= 0 ? 1 : 0;
  return lit;
}

LightNoise light_noise(const Detector& detector) {
  const double read_noise_adu = detector.read_noise_e / detector.e_per_adu;
  return {1.0 / detector.e_per_adu, read_noise_adu * read_noise_adu};
}

AirFigure scaled(const AirFigure& figure, double by) {
  return {figure.value * by, figure.error * by};
}

}  // namespace

std::vector<AirEntry> entries_of(const AirReport& report) {
  const AirFigures& f = report.figures;
  std::vector<AirEntry> entries{
      {"r0_pitches", "Fried's parameter by differences of slopes", f.r0_slopes},
      {"r0_zernike_pitches", "Fried's parameter by modes Z4 to Z10", f.r0_zernike},
      {"scintillation_index", "variance of a lenslet's light over its squared mean",
       f.scintillation},
      {"wind_x_pitches_per_s", "drift of the slopes' pattern along x", f.wind_x},
      {"wind_y_pitches_per_s", "drift of the slopes' pattern along y", f.wind_y},
      {"tau0_s", "coherence time, .314 r0/wind", f.tau0},
      {"vortex_wind_x_pitches_per_s", "mean velocity of tracked vortices along x", f.vortex_wind_x},
      {"vortex_wind_y_pitches_per_s", "mean velocity of tracked vortices along y", f.vortex_wind_y},
      {"vortices_per_lenslet", "vortices a frame and lit lenslet", f.vortex_density}};
  if (report.pitch_m > 0.0)
    entries.push_back({"r0_m", "Fried's parameter by differences of slopes, at the lenslets",
                       scaled(f.r0_slopes, report.pitch_m)});
  return entries;
}

std::string doubt_of_r0(const AirFigure& scintillation, double fresnel_pitches) {
  // By simulated paths: at .18 r0 was 4 % too small, at .24 6 %, at .29 14 %.
  constexpr double kMost = 0.2;
  constexpr double kMostOfNearAir = 0.1;
  if (scintillation.value > kMost)
    return fmt::format(
        "r0 is not told: light scintillates by {:.2g}, and beyond {} slopes are not those of "
        "the air's phase alone",
        scintillation.value, kMost);
  if (scintillation.value > kMostOfNearAir && !(fresnel_pitches > 0.0))
    return fmt::format(
        "r0 is not told: light scintillates by {:.2g}, so the air is not near; say by --fresnel "
        "how long the path is",
        scintillation.value);
  return {};
}

std::string doubt_of_modes(double fresnel_pitches, int lenslets) {
  // By simulated paths over 16 lenslets: right at 4 pitches; at 15.6 r0 was 40 % too small.
  constexpr double kMostOfArray = 0.25;
  if (!(fresnel_pitches > kMostOfArray * lenslets)) return {};
  return fmt::format(
      "r0_zernike is not told: by --fresnel diffraction reaches over {:.3g} pitches, and modes of "
      "{} lenslets are then not those of the air's phase",
      fresnel_pitches, lenslets);
}

std::string air_text(const AirReport& report) {
  std::string text =
      fmt::format("air over {} frames, {:.4g} s\n", report.figures.frames, report.figures.seconds);
  for (const AirEntry& entry : entries_of(report))
    if (std::isfinite(entry.figure.value))
      text += fmt::format("{:<28} {:>10.4g} ± {:<8.2g} {}\n", entry.name, entry.figure.value,
                          entry.figure.error, entry.meaning);
  if (!report.without_r0.empty()) text += report.without_r0 + "\n";
  return text;
}

AirMeter::AirMeter(const Plan& plan, const AirOptions& options)
    : plan_(lit_lenslets(plan.split.lattice()), options),
      window_(plan_, light_noise(plan.detector)),
      window_s_(options.window_s),
      fresnel_pitches_(options.fresnel_pitches),
      pitch_m_(plan.optics.pitch_m),
      vortices_(plan.detect.capacity()) {}

AirSample AirMeter::make_sample() const {
  return {plan_.lit().rows(), plan_.lit().cols(), vortices_};
}

void AirMeter::fill(const FrameSlot& slot, AirSample& sample) noexcept {
  sample.time_s = time_s(slot.frame->header);
  sample.sequence = slot.frame->header.sequence;
  sample.slopes = slot.slopes;
  sample.state = slot.centroids.state;
  sum_window_light(slot.plan->centroid, slot.frame->view(), slot.centroids,
                   slot.levels ? &*slot.levels : nullptr, sample.light_adu, sample.area_px);
  sample.vortices.assign(slot.vortices);
}

std::optional<AirReport> AirMeter::add(const AirSample& sample, std::int64_t frame_index) {
  std::optional<AirReport> complete;
  const bool over = begin_s_ && sample.time_s - *begin_s_ >= window_s_;
  // A clock that went back, as that of a camera that was restarted, does not tell the length.
  const bool astray = begin_s_ && sample.time_s < *begin_s_;
  if (over) complete = report();
  if (over || astray) {
    window_.begin_anew();
    begin_s_.reset();
  }
  if (!begin_s_) {
    begin_s_ = sample.time_s;
    first_frame_ = frame_index;
  }
  last_frame_ = frame_index;
  window_.add(sample);
  return complete;
}

AirReport AirMeter::report() const {
  AirReport report{window_.figures(), {}, pitch_m_, first_frame_, last_frame_};
  report.without_r0 = doubt_of_r0(report.figures.scintillation, fresnel_pitches_);
  if (!report.without_r0.empty()) {
    report.figures.r0_slopes = report.figures.r0_zernike = report.figures.tau0 = AirFigure{};
    return report;
  }
  const int lenslets = std::min(plan_.lit().rows(), plan_.lit().cols());
  report.without_r0 = doubt_of_modes(fresnel_pitches_, lenslets);
  if (!report.without_r0.empty()) report.figures.r0_zernike = AirFigure{};
  return report;
}

}  // namespace curlew
