// `curlew kernel`, and a simulated field that is written and read back.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <string>
#include <vector>

#include "acquisition/fits/fits_file.h"
#include "tests/support/program.h"

namespace curlew {
namespace {

TEST(KernelCommand, JsonHoldsTheMap) {
  const ScratchDirectory scratch;
  const ProgramRun run =
      run_curlew(scratch, "kernel --alpha 0.7 --beta 1 --extent 0.4 --step 0.1 --json");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const auto json = nlohmann::json::parse(run.out);
  const auto at = json["positions"].get<std::vector<double>>();
  ASSERT_EQ(at.size(), 9U);
  EXPECT_DOUBLE_EQ(at[4], 0.0);
  EXPECT_NEAR(at[7], 0.3, 1e-12);
  EXPECT_NEAR(json["circulation_rad"][6][7].get<double>(), 3.079614607803, 1e-11);  // (.3, .2)
  EXPECT_NEAR(json["circulation_rad"][4][4].get<double>(), json["peak_rad"].get<double>(), 1e-12);
  EXPECT_NEAR(json["slow_axis_deg"].get<double>(), 90 - 90 / std::numbers::pi, 1e-9);
  const ProgramRun weighted = run_curlew(scratch, "kernel --weight intensity --json");
  EXPECT_NEAR(nlohmann::json::parse(weighted.out)["peak_rad"].get<double>(), 3.0, 1e-12);
}

TEST(KernelCommand, TextAndCsv) {
  const ScratchDirectory scratch;
  const ProgramRun text = run_curlew(scratch, "kernel");
  ASSERT_EQ(text.exit_code, 0) << text.err;
  EXPECT_NE(text.out.find("D = 4.527887 rad"), std::string::npos) << text.out;
  EXPECT_NE(text.out.find("-0.410730"), std::string::npos) << text.out;
  const ProgramRun csv = run_curlew(scratch, "kernel --extent 1 --step 0.5 --csv");
  EXPECT_EQ(std::count(csv.out.begin(), csv.out.end(), '\n'), 26);
  EXPECT_NE(csv.out.find("\n0,0,4.52788701471\n"), std::string::npos) << csv.out;
}

TEST(KernelCommand, BadUsage) {
  const ScratchDirectory scratch;
  for (const char* arguments :
       {"--step 0", "--extent 200", "--extent 1 --step 2", "--extent 100 --step 0.001",
        "--alpha nan", "--weight phase", "--json --csv"}) {
    const ProgramRun run = run_curlew(scratch, std::string("kernel ") + arguments);
    EXPECT_EQ(run.exit_code, 2) << arguments;
    EXPECT_EQ(std::count(run.err.begin(), run.err.end(), '\n'), 1) << run.err;
  }
}

// A field written by one run is the same beam to another run: its phase turns round the same
// vortices.
TEST(SimulateCommand, FieldOutIsReadBack) {
  const ScratchDirectory scratch;
  const std::string array = " --rows 6 --cols 8 --window 8 ";
  ProgramRun run = run_curlew(scratch, "simulate --preset vortex" + array +
                                           "--amplitude linear --core-radius 2 --vortex 2.3,3.2,1 "
                                           "--vortex 5.4,1.7,-1,40,30 --photons 0 --out a.fits "
                                           "--field-out field.fits");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  run = run_curlew(
      scratch, "simulate --preset field --field field.fits" + array + "--photons 0 --out b.fits");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const auto column = [&](const char* file, const char* name) {
    FitsFile fits = FitsFile::open(scratch / file);
    fits.select("TRUTH");
    std::vector<double> values(static_cast<std::size_t>(fits.row_count()));
    fits.read_column<double>(name, 0, values);
    std::sort(values.begin(), values.end());
    return values;
  };
  ASSERT_EQ(column("a.fits", "X").size(), 2U);
  EXPECT_EQ(column("b.fits", "CHARGE"), column("a.fits", "CHARGE"));
  for (const char* name : {"X", "Y"}) {
    const auto written = column("a.fits", name);
    const auto read = column("b.fits", name);
    ASSERT_EQ(read.size(), 2U) << name;
    // The zero is found bilinearly, in a nearly linear field with points 1/32 pitch apart.
    for (std::size_t k = 0; k < 2; ++k) EXPECT_NEAR(read[k], written[k], 2e-3) << name;
  }
  FitsFile a = FitsFile::open(scratch / "a.fits");
  FitsFile b = FitsFile::open(scratch / "b.fits");
  std::vector<double> pixels_a(48UL * 64);
  std::vector<double> pixels_b(48UL * 64);
  a.read_pixels<double>(0, pixels_a);
  b.read_pixels<double>(0, pixels_b);
  for (std::size_t k = 0; k < pixels_a.size(); ++k)
    // Both are scaled to the same peak.
    ASSERT_NEAR(pixels_a[k], pixels_b[k], 1.0) << "pixel " << k;
}

}  // namespace
}  // namespace curlew
