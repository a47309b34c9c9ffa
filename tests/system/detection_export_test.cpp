// The exported benchmark, scored by its own Python, gives the figures of `bench detect`.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>

#include "acquisition/fits/fits_file.h"
#include "tests/support/program.h"

namespace curlew {
namespace {

#ifdef NDEBUG

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
const std::string kFrames = "--realisations 2 --validation 2";
#else
const std::string kFrames = "--realisations 6 --validation 4";
#endif

/// Returns the number that follows a name in the scorer's line; NaN where there is none.
double figure(const std::string& line, const std::string& name) {
  const auto at = line.find(name + " ");
  return at == std::string::npos ? std::nan("") : std::atof(line.c_str() + at + name.size() + 1);
}

std::string score(const ScratchDirectory& scratch, const std::string& entry) {
  const std::string line = "/usr/bin/python3 '" + (scratch / "out/score.py") + "' '" +
                           (scratch / ("out/" + entry)) + "' > '" + (scratch / "said") + "'";
  EXPECT_EQ(std::system(line.c_str()), 0);
  std::ifstream file(scratch / "said");
  std::string said;
  std::getline(file, said);  // there is one cell
  return said;
}

TEST(DetectionExport, ItsScorerGivesTheBenchmarksFigures) {
  const ScratchDirectory scratch;
  const std::string what = "bench detect --rytov 2 --photons 1000 " + kFrames + " --cache cache ";
  const ProgramRun measured = run_curlew(scratch, what + "--json");
  ASSERT_EQ(measured.exit_code, 0) << measured.err;
  const ProgramRun exported = run_curlew(scratch, what + "--export out");
  ASSERT_EQ(exported.exit_code, 0) << exported.err;
  const nlohmann::json cell = nlohmann::json::parse(measured.out)["cells"][0];
  for (const auto& row : cell["rows"]) {
    if (row["name"] != "classifier" && row["name"] != "whitened") continue;
    const std::string line = score(scratch, row["name"]);
    EXPECT_NE(line.find(": " + std::to_string(cell["required"].get<int>()) + " vortices"),
              std::string::npos)
        << line;
    for (const char* name : {"f1", "average_precision", "recall", "rms"})
      EXPECT_NEAR(figure(line, name), row[name]["value"].get<double>(), 2e-4)
          << name << ": " << line;
  }
  // What was exported is a recording of the sensor, and is not written over.
  FitsFile frames = FitsFile::open(scratch / "out/rytov2_photons1000_test.fits");
  EXPECT_EQ(frames.image().shape.at(1), 96);
  EXPECT_NEAR(frames.key_double("RDNOISE").value_or(0.0), 1.0, 1e-9);
  const ProgramRun calibrated = run_curlew(scratch,
                                           "calibrate out/rytov2_photons1000_reference.fits --dark "
                                           "out/rytov2_photons1000_dark.fits --out sensor.fits");
  EXPECT_EQ(calibrated.exit_code, 0) << calibrated.err;
  EXPECT_NE(run_curlew(scratch, what + "--export out").exit_code, 0);
}

#endif

}  // namespace
}  // namespace curlew
