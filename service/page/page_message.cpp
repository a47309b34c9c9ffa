#include "service/page/page_message.h"

#include <bit>
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>
#include <type_traits>
#include <vector>

#include "service/program/version.h"
#include "service/results/beam_json.h"
#include "service/results/json_float.h"
#include "service/results/json_line.h"

namespace curlew {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::size_t kUnit = 4;  // bytes; every part of a message begins at a multiple of it
static_assert(std::endian::native == std::endian::little);

Json known(double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); }

void pad(std::string& bytes, char with) {
  bytes.resize((bytes.size() + kUnit - 1) / kUnit * kUnit, with);
}

/// Collects the arrays of a message.
class Arrays {
 public:
  template <typename T>
  void add(const char* name, const Image<T>& image) {
    if (!image.empty()) add(name, type_of<T>(), image.rows(), image.cols(), image.data());
  }
  void add(const char* name, const char* type, int rows, int cols, const void* values) {
    const std::size_t width = type[1] == '8' ? 1 : (type[1] == '1' ? 2 : 4);
    list_.push_back({{"name", name}, {"type", type}, {"rows", rows}, {"cols", cols}});
    bytes_.append(static_cast<const char*>(values),
                  width * static_cast<std::size_t>(rows) * static_cast<std::size_t>(cols));
    pad(bytes_, '\0');
  }

  /// json: an object without its closing brace.
  PageMessage message(std::string json) const {
    json += R"(,"arrays":)" + list_.dump() + "}";
    pad(json, ' ');
    const auto length = static_cast<std::uint32_t>(json.size());
    std::string all(kUnit, '\0');
    std::memcpy(all.data(), &length, kUnit);
    all += json;
    all += bytes_;
    return std::make_shared<const std::string>(std::move(all));
  }

 private:
  template <typename T>
  static const char* type_of() {
    if constexpr (std::is_same_v<T, float>) return "f32";
    if constexpr (std::is_same_v<T, std::int32_t>) return "i32";
    return "u8";
  }

  Json list_ = Json::array();
  std::string bytes_;
};

Json optics_of(const Plan& plan) {
  const Optics& optics = plan.optics;
  const Detector& detector = plan.detector;
  return {{"pitch_um", known(1e6 * optics.pitch_m)},
          {"focal_mm", known(1e3 * optics.focal_m)},
          {"pixel_um", known(1e6 * optics.pixel_m)},
          {"wavelength_nm", known(1e9 * optics.wavelength_m)},
          {"magnification", optics.magnification},
          {"mirrored", optics.mirrored},
          {"slope_rad_per_px", known(optics.slope_rad_per_px())},
          {"e_per_adu", known(detector.e_per_adu)},
          {"read_noise_e", known(detector.read_noise_e)},
          {"saturation_adu", known(detector.saturation_adu)},
          {"bit_depth", detector.bit_depth}};
}

/// Returns the coefficients that a fit has; none where it could not be made.
Json zernike_of(const ModePlan& modes, const ModeFit& fit) {
  Json list = Json::array();
  if (modes.modes() == 0 || !std::isfinite(fit.coefficients()[0])) return list;
  for (int i = 0; i < modes.modes(); ++i) {
    const Zernike& mode = modes.zernike(i);
    list.push_back(
        {{"j", i + 2},
         {"n", mode.radial_order()},
         {"m", i % 2 == 0 ? mode.azimuthal_order() : -mode.azimuthal_order()},  // odd j are sines
         {"rad", static_cast<float>(fit.coefficients()[i])}});
  }
  return list;
}

struct Light {
  double sum_adu = 0.0;
  double scintillation = 0.0;  ///< ⟨F²⟩/⟨F⟩² − 1 over the lenslets with a slope
};

Light light_of(const FrameCopy& copy) {
  double sum = 0.0;
  double squares = 0.0;
  for (std::size_t k = 0; k < copy.slopes.valid.size(); ++k) {
    if (copy.slopes.valid[k] == 0) continue;
    const auto flux = static_cast<double>(copy.map(PageMap::kFlux)[k]);
    sum += flux;
    squares += flux * flux;
  }
  return {sum, squares * copy.slopes.n_valid / (sum * sum) - 1.0};
}

Json figures_of(const FrameCopy& copy, const WavefrontFigures& figures, double pitch_m) {
  const Light light = light_of(copy);
  return {{"rms_rad", known(figures.rms_rad)},
          {"pv_rad", known(figures.peak_to_valley_rad)},
          {"strehl", known(figures.strehl())},
          {"flux_adu", known(light.sum_adu)},
          {"scintillation", known(light.scintillation)},
          {"beam", beam_json(measure_beam(copy.map(PageMap::kFlux), copy.state), pitch_m)},
          {"level_adu", known(copy.level_adu)},
          {"noise_adu", known(copy.noise_adu)},
          {"n_saturated", copy.n_saturated},
          {"windows", static_cast<int>(copy.follow_state)}};
}

}  // namespace

PagePlan::PagePlan(std::shared_ptr<const Plan> plan, std::int64_t number, std::string title)
    : plan_(std::move(plan)), number_(number), title_(std::move(title)), meter_(plan_->split) {}

PageMessage PagePlan::description() const {
  const LensletGrid& grid = plan_->grid;
  const Image<CentroidPlan::Spot>& spots = plan_->centroid.spots;
  Image<std::int32_t> windows(4 * spots.rows(),
                              spots.cols());  // x0, y0, w and h, one after another
  Image<std::uint8_t> lit(spots.rows(), spots.cols());
  for (std::size_t k = 0; k < spots.size(); ++k) {
    const CentroidPlan::Spot& spot = spots[k];
    const std::array<int, 4> window{spot.x0, spot.y0, spot.w, spot.h};
    for (std::size_t i = 0; i < window.size(); ++i) windows[i * spots.size() + k] = window[i];
    lit[k] = spot.state == LensletState::kUnlit ? 0 : 1;
  }
  const Json json{{"kind", "sensor"},
                  {"plan", number_},
                  {"title", title_},
                  {"program", kProgram},
                  {"rows", grid.rows},
                  {"cols", grid.cols},
                  {"frame_rows", plan_->centroid.frame_rows},
                  {"frame_cols", plan_->centroid.frame_cols},
                  {"origin_px", {grid.origin_x_px, grid.origin_y_px}},
                  {"p_px", {grid.p11, grid.p12, grid.p21, grid.p22}},
                  {"pitch_px", grid.pitch_px()},
                  {"optics", optics_of(*plan_)},
                  {"method", name_of(plan_->detect.choice().method)},
                  {"sensor_hash", plan_->sensor_hash},
                  {"configuration_hash", config_hash(plan_->config)},
                  {"configuration", config_text(plan_->config)}};
  Arrays arrays;
  arrays.add("windows", windows);
  arrays.add("lit", lit);
  arrays.add("ref_x_px", plan_->slopes.ref_x_px);
  arrays.add("ref_y_px", plan_->slopes.ref_y_px);
  std::string text = json.dump(-1, ' ', false, Json::error_handler_t::replace);
  text.pop_back();
  return arrays.message(std::move(text));
}

PageMessage PagePlan::frame(const FrameCopy& copy, const std::string& tail) {
  const WavefrontFigures figures = meter_.measure(copy.map(PageMap::kPhase), copy.slopes);
  std::string json = R"({"kind":"frame","plan":)" + std::to_string(number_) + R"(,"result":)";
  append_json_line(copy.result, json);
  json.pop_back();  // the line feed
  json += R"(,"scale_adu":)" + Json(copy.format.scale_adu).dump() + R"(,"zero_adu":)" +
          Json(copy.format.zero_adu).dump() + R"(,"figures":)" +
          figures_of(copy, figures, plan_->optics.pitch_m).dump() + R"(,"zernike":)" +
          zernike_of(meter_.modes(), meter_.fit()).dump() + tail;
  Arrays arrays;
  const FrameFormat& format = copy.format;
  arrays.add("pixels", format.pixel_type == PixelType::kU8 ? "u8" : "u16", format.rows, format.cols,
             copy.pixels.data());
  for (std::size_t i = 0; i < kPageMaps.size(); ++i) arrays.add(kPageMaps[i].name, copy.maps[i]);
  arrays.add("slope_x", copy.slopes.x);
  arrays.add("slope_y", copy.slopes.y);
  arrays.add("slope_valid", copy.slopes.valid);
  arrays.add("state", copy.state);
  arrays.add("circulation_valid", copy.circulation_valid);
  return arrays.message(std::move(json));
}

std::string PagePlan::point(const FrameCopy& copy) {
  Json tracks = Json::array();
  for (const Vortex& vortex : copy.result.vortices)
    if (vortex.track >= 0)
      tracks.push_back({vortex.track, static_cast<int>(vortex.charge), json_float(vortex.x),
                        json_float(vortex.y)});
  const WavefrontFigures figures = meter_.measure(copy.map(PageMap::kPhase), copy.slopes);
  const Json point{
      {"frame", copy.result.frame_index}, {"vortices", copy.result.vortices.size()},
      {"rms", known(figures.rms_rad)},    {"scintillation", known(light_of(copy).scintillation)},
      {"lost", copy.result.n_lost},       {"tracks", std::move(tracks)}};
  return point.dump();
}

PageMessage plain_message(std::string json) {
  json.pop_back();
  return Arrays{}.message(std::move(json));
}

}  // namespace curlew
