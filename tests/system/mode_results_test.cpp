// Zernike coefficients and figures of the wavefront in a results file, beside what was simulated.
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <numbers>

#include "acquisition/fits/fits_file.h"
#include "core/zernike.h"
#include "tests/support/program.h"

namespace curlew {
namespace {

std::vector<double> column(FitsFile& file, const std::string& table, const std::string& name) {
  file.select(table);
  std::vector<double> values(static_cast<std::size_t>(file.row_count()));
  file.read_column<double>(name, 0, values);
  return values;
}

/// Returns the rms of a phase at the centres of a round pupil's 20 × 20 lenslets, less its tilt.
double rms_at_lenslets(const std::map<std::size_t, double>& coefficients) {
  double sum = 0.0;
  int lenslets = 0;
  for (int row = 0; row < 20; ++row)
    for (int col = 0; col < 20; ++col) {
      const double x = (col - 9.5) / 10.0;
      const double y = (row - 9.5) / 10.0;
      if (x * x + y * y > 1.0) continue;
      double phase = 0.0;
      for (const auto& [noll, rms] : coefficients)
        if (noll > 3) phase += rms * Zernike(static_cast<int>(noll))(x, y);
      sum += phase * phase;
      ++lenslets;
    }
  return std::sqrt(sum / lenslets);
}

TEST(ModeResultsFile, CoefficientsAndFiguresAreThoseThatWereSimulated) {
  const ScratchDirectory scratch;
  const auto run = [&](const std::string& arguments) {
    const ProgramRun program = run_curlew(scratch, arguments);
    ASSERT_EQ(program.exit_code, 0) << arguments << "\n" << program.err;
  };
  const std::string size =
      "--rows 20 --cols 20 --window 16 --pupil round --bits 16 --photons 1000000 --e-per-adu 20 ";
  run("simulate --preset plane " + size + "--frames 10 --out ref.fits");
  run("calibrate ref.fits --out sensor.fits");
  run("simulate --preset plane " + size +
      "--frames 3 --zernike 2:0.4 --zernike 4:0.3 --zernike 5:-0.2 --zernike 7:0.15 --zernike "
      "11:0.1 "
      "--out beam.fits");
  run("replay beam.fits --sensor sensor.fits --save zernike --out results.fits");
  FitsFile file = FitsFile::open(scratch / "results.fits");
  file.select("ZERNIKE");
  ASSERT_EQ(file.image().shape, (std::vector<std::int64_t>{3, 35}));
  EXPECT_NEAR(file.key_double("ZERNR").value(), 10.0, 1e-9);
  const double wavelength_m = [&] {
    FitsFile sensor = FitsFile::open(scratch / "sensor.fits");
    return sensor.key_double("WAVELEN").value();
  }();
  std::vector<double> coefficients(3 * 35);
  file.read_pixels<double>(0, coefficients);
  const std::map<std::size_t, double> truth{{2, 0.4}, {4, 0.3}, {5, -0.2}, {7, 0.15}, {11, 0.1}};
  for (std::size_t i = 0; i < coefficients.size(); ++i) {
    const std::size_t noll = i % 35 + 2;
    // The tolerance is the noise of a million photons a lenslet, and the spots' own errors.
    EXPECT_NEAR(coefficients[i], truth.contains(noll) ? truth.at(noll) : 0.0, 0.01) << noll;
  }
  const std::vector<double> m = column(file, "ZERNIKE_MODES", "M");
  EXPECT_EQ((std::vector<double>(m.begin(), m.begin() + 6)),
            (std::vector<double>{1, -1, 0, -2, 2, -1}));
  const double rms_rad = rms_at_lenslets(truth);
  EXPECT_NEAR(rms_rad, std::sqrt(0.09 + 0.04 + 0.0225 + 0.01), 0.01) << "as over the disc";
  const double rms_nm = rms_rad / (2.0 * std::numbers::pi) * wavelength_m * 1e9;
  for (std::size_t frame = 0; frame < 3; ++frame) {
    EXPECT_NEAR(column(file, "WAVEFRONT", "RMS_NM")[frame], rms_nm, 0.01 * rms_nm);
    EXPECT_NEAR(column(file, "WAVEFRONT", "STREHL")[frame], std::exp(-rms_rad * rms_rad), 0.01);
    EXPECT_NEAR(column(file, "WAVEFRONT", "TILT_X_WAVES")[frame],
                4.0 * 0.4 / (2.0 * std::numbers::pi), 0.01);
    EXPECT_NEAR(column(file, "WAVEFRONT", "CURVATURE_WAVES")[frame],
                2.0 * std::sqrt(3.0) * 0.3 / (2.0 * std::numbers::pi), 0.01);
  }
}

}  // namespace
}  // namespace curlew
