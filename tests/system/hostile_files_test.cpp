// Files that are meant to hurt, given to every command that reads files: no crash, no hang, no
// memory beyond the limit, one sentence, a non-zero exit.
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <zlib.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "acquisition/fits/fits_file.h"
#include "tests/support/paths.h"
#include "tests/support/process.h"
#include "tests/support/program.h"
#include "tests/support/raw_fits.h"
#include "tests/support/sanitized.h"
#include "tests/system/bench_optics.h"

namespace curlew {
namespace {

using std::chrono::seconds;

// Far above the 0.3 GB that the libraries map, and below what a bomb takes. A sanitizer maps all.
constexpr const char* kLimits = kSanitized ? "timeout 60" : "ulimit -v 1500000; timeout 60";

std::string padded(std::string card) {
  card.resize(80, ' ');
  return card;
}

/// Replaces the first card of this key, or else the first blank one, or else puts a block before
/// END.
void set_card(std::string& file, const std::string& key, const std::string& value) {
  std::string name = key;
  name.resize(8, ' ');
  std::size_t at = file.find(name + "=");
  if (at == std::string::npos) {
    at = file.find(padded("END"));
    file.insert(at + 80, std::string(2880 - 80, ' ') + padded("END"));
    file.replace(at, 80, padded(""));
  }
  file.replace(at, 80, padded(raw_card(key, value)));
}

class HostileFiles : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = std::make_unique<ScratchDirectory>();
    const std::string small = "--rows 6 --cols 6 --photons 2000 --frames 5 --out ";
    ASSERT_EQ(run_curlew(*folder_, "simulate " + small + "ref.fits").exit_code, 0);
    const ProgramRun run = run_curlew(*folder_, "calibrate ref.fits --out sensor.fits");
    ASSERT_EQ(run.exit_code, 0) << run.err;
    const std::string replay = "replay ref.fits --sensor sensor.fits --save slopes,flux --out ";
    ASSERT_EQ(run_curlew(*folder_, replay + "results.fits").exit_code, 0);
  }
  static void TearDownTestSuite() {
    folder_.reset();
    rusage used{};
    getrusage(RUSAGE_CHILDREN, &used);
    std::printf("%d runs, the longest %.1f s, the largest %.0f MB\n", runs_, longest_s_,
                static_cast<double>(used.ru_maxrss) / 1024.0);
  }
  static ProgramRun run_within_limits(const ScratchDirectory& folder,
                                      const std::string& arguments) {
    const auto begin = std::chrono::steady_clock::now();
    ProgramRun run = run_curlew(folder, arguments, kLimits);
    const std::chrono::duration<double> lasted = std::chrono::steady_clock::now() - begin;
    ++runs_;
    longest_s_ = std::max(longest_s_, lasted.count());
    return run;
  }

  /// Runs one command on the file. Returns its exit code; expects one sentence if it is not 0.
  static int run(const std::string& arguments, const std::string& file,
                 const ScratchDirectory& folder = *folder_) {
    const ProgramRun run = run_within_limits(folder, arguments);
    const std::string what = arguments + "\nstderr: " + run.err;
    EXPECT_LE(run.exit_code, 2) << what;
    if (run.exit_code == 0) return 0;
    // The daemon has a log before it.
    const std::size_t begin = run.err.rfind("curlew: ");
    EXPECT_TRUE(begin == 0 || arguments.starts_with("run ")) << what;
    const std::string sentence = run.err.substr(std::min(begin, run.err.size()));
    EXPECT_EQ(std::count(sentence.begin(), sentence.end(), '\n'), 1) << what;
    EXPECT_NE(sentence.find(file), std::string::npos) << what;
    EXPECT_EQ(run.err.find('\x1b'), std::string::npos) << what;
    return run.exit_code;
  }
  /// Returns the commands that read a sensor file, with this one.
  static std::vector<std::string> commands_with_sensor(const std::string& file) {
    return {"replay ref.fits --sensor " + file + " --out new.fits",
            "run --camera file:ref.fits --sensor " + file + " --frames 1",
            "export results.fits --aot --recording ref.fits --sensor " + file + " --out new.fits"};
  }
  /// Returns the commands that read a configuration, with this file.
  static std::vector<std::string> commands_with_configuration(const std::string& file) {
    return {"replay ref.fits --sensor sensor.fits --config " + file,
            "replay ref.fits --sensor sensor.fits --out new.fits --sweep " + file,
            "calibrate ref.fits --out new.fits --config " + file,
            "run --config " + file + " --camera file:ref.fits --sensor sensor.fits --frames 1",
            "doctor --seconds 0 --config " + file};
  }
  /// Returns the commands that read frames, maps or results, with this file.
  static std::vector<std::string> commands_with_frames(const std::string& file) {
    return {
        "replay " + file + " --sensor sensor.fits --out new.fits",
        "calibrate " + file + kOptics + "--out new.fits",
        "calibrate ref.fits --dark " + file + " --out new.fits",
        "calibrate ref.fits --flat " + file + " --out new.fits",
        "calibrate ref.fits --bad-pixels " + file + " --out new.fits",
        "simulate --preset field --field " + file + " --out new.fits",
        "run --camera file:" + file + " --sensor sensor.fits --frames 1",
        "convert " + file + " --out new.fits",
        "convert " + file + " --milk new",
        "merge " + file + " --out new.fits",
        "export " + file + " --aot --recording ref.fits --sensor sensor.fits --out new.fits",
        "export results.fits --aot --recording " + file + " --sensor sensor.fits --out new.fits"};
  }
  static bool reads_sensor(const std::string& command, const std::string& file) {
    return command.find("--sensor " + file) != std::string::npos;
  }
  static void expect_all_refuse(const std::string& file) {
    std::vector<std::string> commands = commands_with_frames(file);
    for (const std::string& command : commands_with_sensor(file)) commands.push_back(command);
    for (const std::string& command : commands) {
      EXPECT_NE(run(command, file), 0) << command;
      EXPECT_FALSE(std::filesystem::exists(*folder_ / "new.fits")) << command;
    }
  }
  static std::string path(const std::string& name) { return *folder_ / name; }

  static std::unique_ptr<ScratchDirectory> folder_;
  static int runs_;
  static double longest_s_;
};
std::unique_ptr<ScratchDirectory> HostileFiles::folder_;
int HostileFiles::runs_ = 0;
double HostileFiles::longest_s_ = 0.0;

TEST_F(HostileFiles, HeadersThatOverrunCfitsio) {
  const std::string many = raw_image_header(16, std::vector<std::string>(120, "1"));
  write_bytes(path("axes.fits"), many + std::string(2880, '\0'));
  expect_all_refuse("axes.fits");

  std::string extension = many;
  extension.replace(0, 80, padded(raw_card("XTENSION", "'IMAGE   '")));
  write_bytes(path("second.fits"), read_bytes(path("ref.fits")) + extension);
  expect_all_refuse("second.fits");

  for (const std::string name : {"ref.fits", "sensor.fits"}) {
    std::string bytes = read_bytes(path(name));
    set_card(bytes, "OFFSETX", "'\x1b[31maaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa'");
    write_bytes(path("text.fits"), bytes);
    expect_all_refuse("text.fits");
  }
}

TEST_F(HostileFiles, KeysOfTileCompression) {
  FitsFile out = FitsFile::create(path("whole.fits"));
  out.create_compressed_image(ElementType::kU16, {2, 48, 48});
  out.commit();
  const std::vector<std::pair<std::string, std::string>> cards{
      {"ZTILE1", "0"}, {"ZVAL1", "0"}, {"ZNAXIS1", "-1"}, {"ZBITPIX", "0"}, {"ZNAXIS", "99"}};
  for (const auto& [key, value] : cards) {
    std::string bytes = read_bytes(path("whole.fits"));
    set_card(bytes, key, value);
    write_bytes(path("tiles.fits"), bytes);
    EXPECT_NE(run("replay tiles.fits --sensor sensor.fits", "tiles.fits"), 0) << key;
    EXPECT_NE(run("calibrate ref.fits --dark tiles.fits --out new.fits", "tiles.fits"), 0) << key;
  }
}

TEST_F(HostileFiles, AGzipBomb) {
  gzFile out = gzopen(path("bomb.fits.gz").c_str(), "wb1");
  const std::string head = raw_image_header(8, {"48", "48", "1000000"});
  gzwrite(out, head.data(), static_cast<unsigned>(head.size()));
  const std::string zeros(10'000'000, '\0');
  for (int i = 0; i < 40; ++i) gzwrite(out, zeros.data(), static_cast<unsigned>(zeros.size()));
  gzclose(out);
  EXPECT_NE(run("replay bomb.fits.gz --sensor sensor.fits", "bomb.fits.gz"), 0);
  EXPECT_NE(run("replay ref.fits --sensor bomb.fits.gz", "bomb.fits.gz"), 0);
}

TEST_F(HostileFiles, Configurations) {
  std::string dotted = "a";
  for (int i = 0; i < 30000; ++i) dotted += ".a";
  write_bytes(path("dotted.toml"), dotted + " = 1\n");
  std::string features = "[camera.features]\n";
  for (int i = 0; i < 700'000; ++i) features.append("f").append(std::to_string(i)).append(" = 1\n");
  write_bytes(path("features.toml"), features);
  write_bytes(path("binary.toml"), std::string("a = \"\xff\xfe\0\"\n", 10));
  for (const std::string file : {"dotted.toml", "features.toml", "binary.toml"})
    for (const std::string& command : commands_with_configuration(file))
      EXPECT_EQ(run(command, file), 2) << command;
}

TEST_F(HostileFiles, MemoryIsToldBeforeItIsTaken) {
  EXPECT_EQ(run("simulate --rows 2000 --cols 2000 --out new.fits", "MB of memory"), 1);
#ifdef NDEBUG  // a debug build times nothing
  EXPECT_EQ(run("bench split --rows 1000 --cols 1000", "MB of memory"), 1);
#endif
  write_bytes(path("recorder.toml"),
              "[recorder]\nmode = \"continuous\"\nmemory_mb = 1000000\n[camera]\nsource = "
              "\"file:ref.fits\"\n[daemon]\nsensor = \"sensor.fits\"\n");
  const ProgramRun run = run_curlew(*folder_, "run --config recorder.toml", kLimits);
  EXPECT_EQ(run.exit_code, 2) << run.err;
  EXPECT_NE(run.err.find("recorder.memory_mb = 1000000"), std::string::npos) << run.err;
}

// Results that fit no sensor, and compressed ones that would be a thousand times as large.
TEST_F(HostileFiles, ResultsOfOtherShapes) {
  const auto write = [&](const std::string& name, const std::vector<std::int64_t>& slopes) {
    FitsFile file = FitsFile::create(path(name));
    file.create_image(ElementType::kF32, {5, 6, 6}, "FLUX");
    file.write_pixels<float>(0, std::vector<float>(5 * 6 * 6));
    const std::vector<ColumnSpec> columns{{"SEQUENCE", 'K', ""}, {"RECEIVED_NS", 'K', ""}};
    file.create_table("FRAMES", columns);
    for (const ColumnSpec& column : columns)
      file.write_column<std::int64_t>(column.name, 0, std::vector<std::int64_t>(5));
    file.create_compressed_image(ElementType::kU8, slopes);
    file.write_key("EXTNAME", std::string("SLOPES"));
    file.commit();
    return run("export " + name + " --aot --recording ref.fits --sensor sensor.fits --out new.fits",
               name);
  };
  EXPECT_EQ(write("short.fits", {5, 2, 6, 5}), 1);
  EXPECT_EQ(write("odd.fits", {7, 1}), 1);
  EXPECT_EQ(write("large.fits", {20'000, 256, 256}), 1);
  EXPECT_FALSE(std::filesystem::exists(path("new.fits")));
}

TEST_F(HostileFiles, TheDaemonSurvivesThemWhenItReloads) {
  const std::string config = path("daemon.toml");
  const std::string sensor = path("live.fits");
  write_bytes(config, "[camera]\nsource = \"sim:plane\"\nframe_rate_hz = 50\n");
  Process daemon({kCurlewProgram, "run", "--config", config}, path("daemon.out"),
                 path("daemon.err"));
  ASSERT_TRUE(daemon.says("state=streaming", seconds(60))) << daemon.err();

  std::string text = read_bytes(path("sensor.fits"));
  set_card(text, "OFFSETX", "'aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa'");
  const std::vector<std::pair<std::string, std::string>> files{
      {raw_image_header(16, std::vector<std::string>(120, "1")), "NAXIS is 120"},
      {text, "the key OFFSETX as an integer"}};
  write_bytes(config, read_bytes(config) + "[daemon]\nsensor = \"" + sensor + "\"\n");
  for (const auto& [bytes, sentence] : files) {
    write_bytes(sensor, bytes);
    daemon.signal(SIGHUP);
    EXPECT_TRUE(daemon.says(sentence, seconds(60))) << daemon.err();
  }
  EXPECT_TRUE(daemon.says("the old plan stays", seconds(10)));
  EXPECT_TRUE(daemon.running());
  daemon.signal(SIGTERM);
  EXPECT_EQ(daemon.wait(seconds(60)), 0) << daemon.err();
}

/// The files that once hurt, where they are at hand, in every place where a file is named. Under a
/// sanitizer each file is in a third of the places, and each place has a third of the files, unless
/// CURLEW_EVERY_PLACE is set.
TEST_F(HostileFiles, ThoseThatOnceHurt) {
  const std::filesystem::path given = std::string(kSourceDir) + "/../shared/hostile";
  if (!std::filesystem::is_directory(given)) GTEST_SKIP() << given << " is not there";
  const ScratchDirectory own;
  for (const auto& entry : std::filesystem::directory_iterator(given))
    std::filesystem::copy_file(entry, own / entry.path().filename().string());
  std::vector<std::string> files = own.names();
  std::erase_if(files, [](const std::string& name) {
    return name == "sensor.fits" || name == "beam.fits" || name == "ref.fits";
  });
  const std::string save = " --save slopes,flux --out results.fits";
  ASSERT_EQ(run("replay ref.fits --sensor sensor.fits" + save, "results.fits", own), 0);
  const std::size_t stride = kSanitized && std::getenv("CURLEW_EVERY_PLACE") == nullptr ? 3 : 1;
  int refused = 0;
  int accepted = 0;
  for (std::size_t i = 0; i < files.size(); ++i) {
    const std::string& file = files[i];
    std::vector<std::string> commands = commands_with_sensor(file);
    for (const auto& more : {commands_with_frames(file), commands_with_configuration(file)})
      commands.insert(commands.end(), more.begin(), more.end());
    commands.push_back("convert " + file + " --raw 8x8 --out new.fits");
    for (std::size_t place = i % stride; place < commands.size(); place += stride) {
      const std::string& command = commands[place];
      // Pixels without a header may be anything, and what hurt as a sensor may be whole as frames.
      const bool may_be_read = command.find("--raw") != std::string::npos ||
                               (file.starts_with("sensor_") && !reads_sensor(command, file));
      const bool is_read = run(command, file, own) == 0;
      EXPECT_TRUE(!is_read || may_be_read || file == "sensor_flat_1e-30.fits") << command;
      ++(is_read ? accepted : refused);
      for (const char* made : {"new.fits", "new"}) std::filesystem::remove_all(own / made);
    }
  }
  std::printf("%zu files: %d runs refused, %d accepted\n", files.size(), refused, accepted);
  const std::string weak = "replay beam.fits --sensor sensor_flat_1e-30.fits --jsonl o.jsonl";
  ASSERT_EQ(run(weak, "sensor_flat", own), 0);
  EXPECT_EQ(read_bytes(own / "o.jsonl").find("\"x\":null"), std::string::npos);
}

}  // namespace
}  // namespace curlew
