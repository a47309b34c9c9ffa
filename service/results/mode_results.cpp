#include "service/results/mode_results.h"

#include <cmath>
#include <limits>
#include <numbers>
#include <span>
#include <vector>

#include "core/as_size.h"
#include "service/results/memory_table.h"

namespace curlew {
namespace {

/// Writes the rows of a table of floats as the pixels of the current image.
void write_rows(FitsFile& file, const RowTable& table) {
  std::int64_t first = 0;
  std::vector<float> pixels;
  table.for_each_block([&](std::span<const std::byte> bytes) {
    pixels.clear();
    for (std::size_t at = 0; at < bytes.size(); at += sizeof(float))
      pixels.push_back(cell_value<float>(bytes.data() + at));
    file.write_pixels<float>(first, pixels);
    first += static_cast<std::int64_t>(pixels.size());
  });
}

}  // namespace

ModeResults::ModeResults(const Plan& plan, const std::string& beside)
    : meter_(plan.split),
      wavelength_m_(plan.optics.wavelength_m),
      coefficients_("", std::vector<ColumnSpec>(as_size(meter_.modes().modes()), {"", 'E', "rad"}),
                    beside),
      errors_("", std::vector<ColumnSpec>(as_size(meter_.modes().modes()), {"", 'E', "rad"}),
              beside),
      wavefront_("WAVEFRONT",
                 {{"FRAME", 'K', ""},
                  {"RMS_RAD", 'D', "rad"},
                  {"RMS_NM", 'D', "nm"},
                  {"PV_RAD", 'D', "rad"},
                  {"PV_NM", 'D', "nm"},
                  {"STREHL", 'D', ""},
                  {"TILT_X_WAVES", 'D', ""},
                  {"TILT_Y_WAVES", 'D', ""},
                  {"CURVATURE_WAVES", 'D', ""}},
                 beside) {}

void ModeResults::add(const FrameSlot& slot) {
  const WavefrontFigures figures = meter_.measure(slot.split.phase, slot.slopes);
  const Eigen::VectorXd& c = meter_.fit().coefficients();
  for (const double coefficient : c) coefficients_.put(coefficient);
  for (const double error : meter_.fit().find_errors(slot.slopes)) errors_.put(error);
  // From rim to rim of the disc Z2 and Z3 go from −2 to 2, and from centre to rim Z4 by 2√3. Over
  // an annulus of inner radius ε the modes are Z2/√(1 + ε²) and Z4/(1 − ε²), but for the piston.
  const double e2 = std::pow(meter_.modes().pupil().obscuration, 2);
  const double waves = 1.0 / (2.0 * std::numbers::pi);
  const double tilt = 4.0 * waves / std::sqrt(1.0 + e2);
  const double sag = 2.0 * std::sqrt(3.0) * waves / (1.0 - e2);
  const auto mode = [&](Eigen::Index i) {
    return i < c.size() ? c[i] : std::numeric_limits<double>::quiet_NaN();
  };
  wavefront_.append(slot.frame_index, figures.rms_rad, nm_of(figures.rms_rad, wavelength_m_),
                    figures.peak_to_valley_rad, nm_of(figures.peak_to_valley_rad, wavelength_m_),
                    figures.strehl(), tilt * mode(0), tilt * mode(1), sag * mode(2));
}

void ModeResults::write(FitsFile& file) const {
  const ModePlan& plan = meter_.modes();
  const std::int64_t modes = plan.modes();
  file.create_image(ElementType::kF32, {coefficients_.rows(), modes}, "ZERNIKE", "rad");
  const ZernikePupil& pupil = plan.pupil();
  file.write_key("ZERNX", pupil.x, "centre of the pupil, lenslet units");
  file.write_key("ZERNY", pupil.y, "centre of the pupil, lenslet units");
  file.write_key("ZERNR", pupil.radius, "radius of the pupil, pitches");
  file.write_key("ZERNEPS", pupil.obscuration, "inner radius over radius; 0: disc");
  write_rows(file, coefficients_);
  file.create_image(ElementType::kF32, {errors_.rows(), modes}, "ZERNIKE_ERR", "rad");
  write_rows(file, errors_);
  MemoryTable names("ZERNIKE_MODES", {{"NOLL", 'J', ""}, {"N", 'J', ""}, {"M", 'J', ""}});
  for (int i = 0; i < plan.modes(); ++i) {
    const Zernike& zernike = plan.zernike(i);
    // Noll's odd indices are the sines, which have a negative m in OSA's numbering.
    const int noll = i + 2;
    const int m = zernike.azimuthal_order();
    names.append(noll, zernike.radial_order(), noll % 2 == 0 ? m : -m);
  }
  names.write(file);
  wavefront_.write(file);
}

}  // namespace curlew
