// The daemon for an hour with everything on, while cameras die, files vanish and reloads come in.
// All that it writes is read, counted and taken away at once, so that the disk does not fill up.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <set>

#include "acquisition/recording/fits_source.h"
#include "service/daemon/control_socket.h"
#include "tests/support/http.h"
#include "tests/system/daemon_fixture.h"

namespace curlew {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using std::chrono::milliseconds;
using std::chrono::seconds;
using Clock = std::chrono::steady_clock;

/// Says once in every period that it is over.
class Every {
 public:
  explicit Every(seconds period) : period_(period), next_(Clock::now() + period) {}
  bool due() {
    if (Clock::now() < next_) return false;
    next_ += period_;
    return true;
  }

 private:
  seconds period_;
  Clock::time_point next_;
};

struct Usage {
  long memory_kb = 0;
  int files = 0;
  int threads = 0;
};

class Soak : public Daemon {
 protected:
  void SetUp() override {
    const std::string size = "--rows 8 --cols 8 --window 8 ";
    run("simulate --preset plane " + size + "--frames 20 --photons 20000 --bits 14 --out ref.fits");
    run("calibrate ref.fits --out sensor.fits");
    run("simulate --preset vortex " + size +
        "--amplitude linear --core-radius 1.5 --vortex 2.4,2.6,+1 --vortex 5.7,5.2,-1 "
        "--velocity 0,0 --photons 1500 --seed 7701 --out beam.fits --frames 60");
    for (const std::string& folder : {recordings_, streams_, taken_}) fs::create_directory(folder);
    configure(.01);
  }
  void configure(double false_alarms) const {
    std::ofstream(config_) << "[camera]\nsource = \"aravis:127.0.0.1\"\ntimeout_s = 1\n"
                           << "max_backoff_s = 0.5\n[daemon]\nsensor = \""
                           << scratch_ / "sensor.fits"
                           << "\"\njsonl = \"" << lines_
                           << "\"\njsonl_max_mb = 8\njsonl_max_s = 10\ncontrol = \"" << socket_
                           << "\"\n[recorder]\nmode = \"continuous\"\nfolder = \"" << recordings_
                           << "\"\nmax_file_s = 12\nmemory_mb = 64\n[publish]\nfolder = \""
                           << streams_ << "\"\nstreams = [\"slopes\", \"phase\", \"vortices\"]\n"
                           << "[metrics]\nlisten = \"127.0.0.1:" << kMetricsPort
                           << "\"\n[track]\nenabled = true\n[detect]\n"
                           << "false_alarms_per_frame = " << false_alarms << "\n";
  }

  /// Moves the file of lines away that the daemon has put aside, and counts its lines.
  void take_lines(const std::string& from) {
    const std::string to = taken_ + "/" + std::to_string(++names_);
    if (std::rename(from.c_str(), to.c_str()) == 0) count_lines(to);
  }
  void count_lines(const std::string& path) {
    for (const json& line : json_lines(path)) {
      ++lines_read_;
      const auto frame = line["frame"].get<std::size_t>();
      frames_.resize(std::max(frames_.size(), frame + 1));
      EXPECT_FALSE(frames_[frame]) << "frame " << frame << " has two lines";
      frames_[frame] = true;
      for (const json& vortex : line["vortices"])
        tracks_.insert(vortex["track"].get<std::int64_t>());
    }
    fs::remove(path);
  }
  /// Returns the recordings' paths, the newest last.
  std::vector<std::string> recordings() const {
    std::vector<std::string> paths;
    for (const auto& entry : fs::directory_iterator(recordings_))
      paths.push_back(entry.path().string());
    std::sort(paths.begin(), paths.end());
    return paths;
  }
  /// Counts the frames of all recordings but the newest `keep`, and removes them.
  void take_recordings(std::size_t keep) {
    const std::vector<std::string> paths = recordings();
    for (std::size_t i = 0; i + keep < paths.size(); ++i) {
      frames_recorded_ += FitsSource({paths[i]}).frame_count();
      fs::remove(paths[i]);
    }
    if (!paths.empty() && paths.back() > newest_) {
      newest_ = paths.back();
      newest_since_ = Clock::now();
    }
  }
  /// Removes the file that is being written, if no other can have been begun in its stead.
  void remove_a_recording() {
    const auto age = Clock::now() - newest_since_;
    if (age < seconds(1) || age > seconds(6) || Clock::now() - reloaded_ < seconds(3)) return;
    removed_ += fs::remove(newest_) ? 1 : 0;
  }
  /// Every other time the configuration is another than before.
  void reload_configuration(const Process& curlew) {
    configure(++reloads_ % 4 < 2 ? .01 : .02);
    curlew.signal(SIGHUP);
    reloaded_ = Clock::now();
  }
  void move_lines_away() {
    if (!moved_.empty()) count_lines(moved_);
    moved_ = taken_ + "/" + std::to_string(++names_);
    if (std::rename(lines_.c_str(), moved_.c_str()) != 0) moved_.clear();
  }
  /// Ends the camera without a word, and has another one in its place.
  void replace_camera(std::unique_ptr<Process>& server) {
    server->signal(SIGKILL);
    server->wait(seconds(5));
    ++deaths_;
    server = serve({"--rate", "1000"});
  }
  void look_at(const Process& curlew) {
    const json status = json::parse(ask_daemon(socket_, "status"));
    const std::string state = status["state"].get<std::string>();
    // While it connects, Aravis has threads and sockets more.
    if (state != "streaming" && state != "degraded") return;
    usage_.push_back({curlew.memory_kb(), curlew.open_files(), curlew.threads()});
    EXPECT_NE(ask_http(kMetricsPort, "GET /metrics HTTP/1.1\r\nHost: a\r\n\r\n").find("200 OK"),
              std::string::npos);
  }
  void expect_flat() const {
    ASSERT_GE(usage_.size(), 4U);
    const std::size_t quarter = usage_.size() / 4;
    const auto least = [&](std::size_t begin, auto of) {
      auto value = of(usage_[begin]);
      for (std::size_t i = begin; i < begin + quarter; ++i) value = std::min(value, of(usage_[i]));
      return value;
    };
    const auto grown = [&](const char* what, auto of) {
      const long then = least(quarter, of);
      const long now = least(usage_.size() - quarter, of);
      std::printf("%s: %ld in the second quarter, %ld in the last\n", what, then, now);
      return now - then;
    };
    // A sanitizer keeps what was freed, and more of it with time.
    const long memory_kb = grown("resident kB", [](const Usage& u) { return u.memory_kb; });
    if (!kSanitized) {
      EXPECT_LE(memory_kb, 2048);
    }
    EXPECT_LE(grown("descriptors", [](const Usage& u) { return long{u.files}; }), 0);
    EXPECT_LE(grown("threads", [](const Usage& u) { return long{u.threads}; }), 0);
  }

  static constexpr int kMetricsPort = 19464;
  const std::string recordings_ = scratch_ / "recordings";
  const std::string streams_ = scratch_ / "streams";
  const std::string taken_ = scratch_ / "taken";
  const std::string lines_ = scratch_ / "live.jsonl";
  const std::string config_ = scratch_ / "curlew.toml";
  const std::string socket_ = scratch_ / "control";

  std::vector<bool> frames_;  ///< those that have a line
  std::set<std::int64_t> tracks_;
  std::int64_t lines_read_ = 0;
  std::int64_t frames_recorded_ = 0;
  std::string newest_;
  Clock::time_point newest_since_;
  Clock::time_point reloaded_;
  std::string moved_;
  int names_ = 0;
  int deaths_ = 0;
  int removed_ = 0;
  int reloads_ = 0;
  std::vector<Usage> usage_;
};

TEST_F(Soak, KeepsItsAccountsAndItsMemory) {
  const char* asked = std::getenv("CURLEW_SOAK_SECONDS");
  const int length_s = asked == nullptr ? 20 : std::stoi(asked);
  auto server = serve({"--rate", "1000"});
  const auto curlew = daemon({"--config", config_});
  ASSERT_TRUE(curlew->says("state=streaming", seconds(30))) << curlew->err();

  Every death(seconds(17)), reload(seconds(11)), removal(seconds(19)), moving(seconds(7)),
      look(seconds(1));
  const auto end = Clock::now() + seconds(length_s);
  while (Clock::now() < end && curlew->running()) {
    std::this_thread::sleep_for(milliseconds(100));
    take_recordings(2);
    take_lines(lines_ + ".1");
    if (death.due()) replace_camera(server);
    if (reload.due()) reload_configuration(*curlew);
    if (removal.due()) remove_a_recording();
    if (moving.due()) move_lines_away();
    if (look.due()) look_at(*curlew);
  }
  curlew->signal(SIGTERM);
  ASSERT_EQ(curlew->wait(seconds(60)), 0) << curlew->err();
  std::printf("%s", curlew->out().c_str());

  if (!moved_.empty()) count_lines(moved_);
  for (const std::string& name : scratch_.names())
    if (name.rfind("live.jsonl", 0) == 0) count_lines(scratch_ / name);
  take_recordings(0);
  const Account account(curlew->out());
  expect_balanced(account);
  const auto said = [&](const char* words) {
    return std::max<std::int64_t>(0, number_before(curlew->out(), words));
  };
  EXPECT_EQ(lines_read_ + said(" results not written"), account.results);
  EXPECT_EQ(frames_recorded_, said(" frames in "));
  EXPECT_EQ(frames_recorded_ + said(" frames dropped"), account.results);
  EXPECT_EQ(said(" for want of a buffer"), 0);
  EXPECT_GE(account.connections, deaths_);
  if (!kSanitized) {
    EXPECT_GT(account.results, 100 * length_s) << "it must reach a tenth of the rate at least";
  }
  std::printf(
      "%d s: %lld lines, %zu tracks, %lld frames in recordings, %d deaths, %d reloads, %d "
      "recordings removed\n",
      length_s, static_cast<long long>(lines_read_), tracks_.size(),
      static_cast<long long>(frames_recorded_), deaths_, reloads_, removed_);
  expect_flat();
}

}  // namespace
}  // namespace curlew
