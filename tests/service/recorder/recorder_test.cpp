#include "service/recorder/recorder.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <random>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "acquisition/fits/fits_file.h"
#include "acquisition/recording/fits_source.h"
#include "core/error.h"
#include "tests/support/allocation_counter.h"
#include "tests/support/eventually.h"
#include "tests/support/failure_text.h"
#include "tests/support/found_recordings.h"
#include "tests/support/numbered_frames.h"
#include "tests/support/paths.h"
#include "tests/support/sanitized.h"
#include "tests/support/scratch_directory.h"

namespace curlew {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;

FrameFormat format_of(int rows, int cols, PixelType type = PixelType::kU16) {
  FrameFormat format;
  format.rows = rows;
  format.cols = cols;
  format.pixel_type = type;
  return format;
}
const FrameFormat kSmall = format_of(50, 100);  // 10 kB

/// Collects what the recorder said, from whichever thread.
class Sentences {
 public:
  std::function<void(const std::string&)> log() {
    return [this](const std::string& sentence) {
      const std::lock_guard lock(mutex_);
      all_.push_back(sentence);
    };
  }
  std::vector<std::string> with(const std::string& part) const {
    const std::lock_guard lock(mutex_);
    std::vector<std::string> some;
    for (const std::string& sentence : all_) {
      if (sentence.find(part) != std::string::npos) some.push_back(sentence);
    }
    return some;
  }

 private:
  mutable std::mutex mutex_;
  std::vector<std::string> all_;
};

/// Hands in numbered frames. add_all() gives the writer time, so that no frame gets lost.
class Source {
 public:
  Source(Recorder& recorder, const FrameFormat& format) : recorder_(recorder), frame_(format) {
    vortices_.push({});
  }

  void add(std::int64_t sequence, bool has_vortex = false) {
    fill_numbered(frame_, sequence);
    recorder_.add(frame_, has_vortex ? &vortices_ : nullptr);
    ++added_;
  }
  /// Hands in frames from..to (to not included), and waits for the writer now and then.
  void add_all(std::int64_t from, std::int64_t to) {
    for (std::int64_t n = from; n < to; ++n) {
      add(n);
      if (n % 50 == 49) std::this_thread::sleep_for(2ms);
    }
  }
  std::int64_t added() const { return added_; }

 private:
  Recorder& recorder_;
  FrameBuffer frame_;
  VortexList vortices_{1};
  std::int64_t added_ = 0;
};

/// Returns whether all frames are on disk or dropped, so that none is on its way.
bool settled(const Recorder& recorder, std::int64_t added) {
  const RecorderCounts counts = recorder.counts();
  return counts.recorded + counts.dropped == added;
}

/// Returns the sequence numbers in each recording of a folder, by name, and checks every pixel.
std::map<std::string, std::vector<std::int64_t>> recorded(const std::string& folder) {
  std::map<std::string, std::vector<std::int64_t>> files;
  for (const auto& entry : fs::directory_iterator(folder)) {
    const std::string path = entry.path().string();
    EXPECT_FALSE(path.ends_with(".partial")) << path;
    FitsSource source({path});
    FrameBuffer frame(source.format());
    FrameBuffer expected(source.format());
    std::vector<std::int64_t>& sequence = files[entry.path().filename().string()];
    while (source.next(frame) == Delivery::kFrame) {
      sequence.push_back(frame.header.sequence);
      fill_numbered(expected, frame.header.sequence);
      EXPECT_TRUE(is_numbered(frame, frame.header.sequence)) << path;
      EXPECT_EQ(frame.header.camera_ns, expected.header.camera_ns) << path;
      EXPECT_EQ(frame.header.received_ns, expected.header.received_ns) << path;
      EXPECT_EQ(frame.header.status, expected.header.status) << path;
    }
  }
  return files;
}

std::vector<std::int64_t> numbers(std::int64_t from, std::int64_t to) {  // `to` is not included
  std::vector<std::int64_t> all;
  for (std::int64_t n = from; n < to; ++n) all.push_back(n);
  return all;
}

/// Returns the files' frames one after the other, in the order of their names.
std::vector<std::int64_t> joined(const std::map<std::string, std::vector<std::int64_t>>& files) {
  std::vector<std::int64_t> all;
  for (const auto& [name, sequence] : files) {
    all.insert(all.end(), sequence.begin(), sequence.end());
  }
  return all;
}

RecorderOptions options_for(const ScratchDirectory& scratch, RecordMode mode) {
  RecorderOptions options;
  options.mode = mode;
  options.folder = scratch.path();
  options.memory_mb = 20;  // 2000 small frames
  options.min_free_mb = 1;
  return options;
}

TEST(Recorder, MemoryThatTheMachineHasNotIsRefusedBeforeItIsTaken) {
  const ScratchDirectory scratch;
  RecorderOptions options = options_for(scratch, RecordMode::kContinuous);
  options.memory_mb = 1'000'000'000;
  EXPECT_THROW(Recorder(options, kSmall, RecordingHeader{}, [](const std::string&) {}), UsageError);
  options.mode = RecordMode::kOff;
  EXPECT_NO_THROW(Recorder(options, kSmall, RecordingHeader{}, [](const std::string&) {}));
}

TEST(Recorder, RecordsEveryFrameAndNamesTheFileByItsFirst) {
  for (const PixelType type : {PixelType::kU8, PixelType::kU16}) {
    const ScratchDirectory scratch;
    const FrameFormat format = format_of(50, 100, type);
    Sentences said;
    {
      Recorder recorder(options_for(scratch, RecordMode::kContinuous), format, RecordingHeader{},
                        said.log());
      Source source(recorder, format);
      source.add_all(7, 1000);
      ASSERT_TRUE(eventually([&] { return settled(recorder, source.added()); }));
      EXPECT_EQ(recorder.counts().dropped, 0);
      EXPECT_EQ(recorder.counts().files, 1);
      EXPECT_FALSE(recorder.counts().stopped);
    }
    const auto files = recorded(scratch.path());
    ASSERT_EQ(files.size(), 1U);
    // The first frame came 1 800 000 000.007 s since 1970.
    EXPECT_EQ(files.begin()->first, "curlew-20270115T080000.007Z.fits");
    EXPECT_EQ(files.begin()->second, numbers(7, 1000));
    EXPECT_EQ(said.with("curlew-20270115T080000.007Z.fits is complete: 993 frames").size(), 1U);
  }
}

TEST(Recorder, NeverOverwritesAFile) {
  const ScratchDirectory scratch;
  for (int run = 0; run < 3; ++run) {
    Sentences said;
    Recorder recorder(options_for(scratch, RecordMode::kContinuous), kSmall, RecordingHeader{},
                      said.log());
    Source(recorder, kSmall).add_all(0, 10 + run);
  }
  const auto files = recorded(scratch.path());
  ASSERT_EQ(files.size(), 3U);
  EXPECT_EQ(files.at("curlew-20270115T080000.000Z.fits"), numbers(0, 10));
  EXPECT_EQ(files.at("curlew-20270115T080000.000Z-2.fits"), numbers(0, 11));
  EXPECT_EQ(files.at("curlew-20270115T080000.000Z-3.fits"), numbers(0, 12));
}

TEST(Recorder, LosesNothingBetweenFiles) {
  for (const bool by_size : {false, true}) {
    const ScratchDirectory scratch;
    RecorderOptions options = options_for(scratch, RecordMode::kContinuous);
    if (by_size) {
      options.max_file_mb = 2;  // a bit less than 200 frames
    } else {
      options.max_file_s = 0.1;  // 100 frames
    }
    Sentences said;
    {
      Recorder recorder(options, kSmall, RecordingHeader{}, said.log());
      Source(recorder, kSmall).add_all(0, 1050);
    }
    const auto files = recorded(scratch.path());
    EXPECT_EQ(joined(files), numbers(0, 1050));
    EXPECT_EQ(files.size(), by_size ? 6U : 11U);
    for (const auto& [name, sequence] : files) {
      EXPECT_LE(fs::file_size(scratch / name), 2'000'000U);
      EXPECT_LE(sequence.size(), by_size ? 200U : 100U);
    }
  }
}

TEST(Recorder, CountsEveryFrameThatItHadNoMemoryFor) {
  const ScratchDirectory scratch;
  RecorderOptions options = options_for(scratch, RecordMode::kContinuous);
  options.memory_mb = 1;
  const FrameFormat format = format_of(512, 512);  // 2 fit into a megabyte, and the least is 4
  Sentences said;
  std::int64_t recorded_count = 0;
  std::int64_t dropped = 0;
  {
    Recorder recorder(options, format, RecordingHeader{}, said.log());
    FrameBuffer frame(format);
    for (std::int64_t n = 0; n < 400; ++n) {  // as fast as memory allows
      frame.header.sequence = n;
      recorder.add(frame);
    }
    ASSERT_TRUE(eventually([&] { return settled(recorder, 400); }));
    recorded_count = recorder.counts().recorded;
    dropped = recorder.counts().dropped;
  }
  EXPECT_GT(dropped, 0);
  EXPECT_GE(recorded_count, 4);
  EXPECT_EQ(recorded_count + dropped, 400);
  std::int64_t on_disk = 0;
  for (const std::string& name : scratch.names()) {
    on_disk += FitsSource({scratch / name}).frame_count();
  }
  EXPECT_EQ(on_disk, recorded_count);
}

/// Returns the recordings of trigger mode. act hands in the frames.
std::map<std::string, std::vector<std::int64_t>> triggered(
    const std::function<void(Recorder&, Source&)>& act, bool on_vortex = false) {
  const ScratchDirectory scratch;
  RecorderOptions options = options_for(scratch, RecordMode::kTrigger);
  options.before_s = 0.1;
  options.after_s = 0.2;
  options.trigger_on_vortex = on_vortex;
  Sentences said;
  {
    Recorder recorder(options, kSmall, RecordingHeader{}, said.log());
    Source source(recorder, kSmall);
    act(recorder, source);
    EXPECT_EQ(recorder.counts().dropped, 0);
  }
  EXPECT_TRUE(said.with("memory_mb").empty());
  return recorded(scratch.path());
}

TEST(Recorder, ATriggerRecordsFromBeforeItToAfterIt) {
  const auto files = triggered([](Recorder& recorder, Source& source) {
    source.add_all(0, 500);
    recorder.trigger();  // the next frame is the trigger
    source.add_all(500, 1000);
  });
  ASSERT_EQ(files.size(), 1U);
  EXPECT_EQ(files.begin()->second, numbers(400, 701));  // both ends included, at 1 kHz
}

TEST(Recorder, WithoutATriggerNothingIsRecorded) {
  EXPECT_TRUE(triggered([](Recorder&, Source& source) {
                source.add_all(0, 300);
                source.add(300, true);  // this frame has a vortex, which is no trigger here
                source.add_all(301, 400);
              }).empty());
}

TEST(Recorder, AVortexIsATriggerWhereThatIsAskedFor) {
  const auto files = triggered(
      [](Recorder&, Source& source) {
        source.add_all(0, 300);
        source.add(300, true);
        source.add_all(301, 1000);
      },
      true);
  ASSERT_EQ(files.size(), 1U);
  EXPECT_EQ(files.begin()->second, numbers(200, 501));
}

TEST(Recorder, AFurtherTriggerExtendsAnEventAndALaterOneBeginsAnother) {
  const auto files = triggered([](Recorder& recorder, Source& source) {
    source.add_all(0, 50);
    recorder.trigger();  // it comes less than before_s after the first frame
    source.add_all(50, 150);
    recorder.trigger();
    source.add_all(150, 400);
    recorder.trigger();  // it comes 50 ms after the end; what was recorded is not recorded again
    source.add_all(400, 700);
    recorder.trigger();
    source.add_all(700, 750);  // the frames end before the event does
  });
  ASSERT_EQ(files.size(), 3U);
  auto file = files.begin();
  EXPECT_EQ(file->second, numbers(0, 351));
  EXPECT_EQ((++file)->second, numbers(351, 601));
  EXPECT_EQ((++file)->second, numbers(601, 750));
}

TEST(Recorder, SaysOnceThatMemoryIsLessThanBeforeAsksFor) {
  const ScratchDirectory scratch;
  RecorderOptions options = options_for(scratch, RecordMode::kTrigger);
  options.memory_mb = 1;  // room for 100 frames, an eighth of it for those that come
  options.before_s = 5.0;
  options.after_s = 0.0;
  Sentences said;
  {
    Recorder recorder(options, kSmall, RecordingHeader{}, said.log());
    Source source(recorder, kSmall);
    // The frames come slowly, so that the recorder can give back what it does not keep.
    for (std::int64_t n = 0; n <= 1000; ++n) {
      if (n == 500 || n == 1000) recorder.trigger();
      source.add(n);
      if (n % 10 == 9) std::this_thread::sleep_for(2ms);
    }
    ASSERT_TRUE(eventually([&] { return recorder.counts().files == 2; }));
  }
  const auto sentences = said.with("memory_mb");
  ASSERT_EQ(sentences.size(), 1U);
  EXPECT_NE(sentences[0].find(" s of the 5.0 s"), std::string::npos) << sentences[0];
  const auto files = recorded(scratch.path());
  ASSERT_EQ(files.size(), 2U);
  EXPECT_GE(files.begin()->second.back(), 500);
  EXPECT_LE(files.begin()->second.size(), 100U);
  EXPECT_GT(files.begin()->second.size(), 50U);
}

TEST(Recorder, CompressesCompleteFilesWithoutLoss) {
  const ScratchDirectory scratch;
  RecorderOptions options = options_for(scratch, RecordMode::kContinuous);
  options.compress = true;
  options.max_file_s = 0.1;
  Sentences said;
  {
    Recorder recorder(options, kSmall, RecordingHeader{}, said.log());
    Source(recorder, kSmall).add_all(0, 350);
    // The compressor stands behind what else wants CPU, which is much where tests run.
    ASSERT_TRUE(eventually([&] { return said.with("is compressed").size() == 3; }, 500s));
  }
  const auto files = recorded(scratch.path());
  EXPECT_EQ(joined(files), numbers(0, 350));
  int compressed = 0;
  for (const auto& [name, sequence] : files) compressed += name.ends_with(".fits.fz") ? 1 : 0;
  EXPECT_GE(compressed, 3);
  EXPECT_EQ(files.size(), 4U) << "the raw files of compressed ones must be deleted";

  const PeerAnswer answer = ask_astropy("recordings", scratch.path());
  if (answer.exit_code == 77) GTEST_SKIP() << "astropy is not installed";
  ASSERT_EQ(answer.exit_code, 0) << answer.text;
  std::int64_t frames = 0;
  for (const FoundRecording& found : found_recordings(answer)) {
    EXPECT_EQ(found.wrong, 0) << found.name;
    EXPECT_EQ(found.warnings, 0) << found.name;
    EXPECT_EQ(found.rows, found.frames) << found.name;
    frames += found.frames;
  }
  EXPECT_EQ(frames, 350);
}

TEST(Recorder, AddAllocatesNothing) {
  if (!kCountsAllocations) GTEST_SKIP() << "the sanitizer owns malloc";
  const ScratchDirectory scratch;
  RecorderOptions options = options_for(scratch, RecordMode::kContinuous);
  options.memory_mb = 1;
  Sentences said;
  Recorder recorder(options, kSmall, RecordingHeader{}, said.log());
  FrameBuffer frame(kSmall);
  for (int n = 0; n < 50; ++n) recorder.add(frame);
  VortexList vortices(1);
  vortices.push({});
  const long allocations = allocations_of_this_thread([&] {
    for (int n = 0; n < 2000; ++n) recorder.add(frame, n % 2 == 0 ? &vortices : nullptr);
    recorder.trigger();
  });
  EXPECT_EQ(allocations, 0);
  EXPECT_GT(recorder.counts().dropped, 0) << "add() must have met both room and no room";
}

TEST(Recorder, AFileThatIsRemovedIsNoticedAndItsFramesCountAsLost) {
  const ScratchDirectory scratch;
  Sentences said;
  Recorder recorder(options_for(scratch, RecordMode::kContinuous), kSmall, RecordingHeader{},
                    said.log());
  Source source(recorder, kSmall);
  source.add_all(0, 100);
  ASSERT_TRUE(eventually([&] { return settled(recorder, 100); }));
  ASSERT_EQ(scratch.names().size(), 1U);
  fs::remove(scratch / scratch.names().front());
  ASSERT_TRUE(eventually([&] { return recorder.counts().dropped == 100; }));
  EXPECT_EQ(said.with("was removed while it was recorded: its 100 frames are lost").size(), 1U);
  source.add_all(100, 150);
  EXPECT_EQ(recorder.finish().recorded, 50);
  EXPECT_EQ(recorder.counts().dropped, 100);
  const auto files = recorded(scratch.path());
  ASSERT_EQ(files.size(), 1U);
  EXPECT_EQ(files.begin()->second, numbers(100, 150));
}

TEST(Recorder, AFolderThatIsReplacedGetsANewFileAndTheOldOneKeepsItsFrames) {
  const ScratchDirectory scratch;
  RecorderOptions options = options_for(scratch, RecordMode::kContinuous);
  options.folder = scratch / "day";
  fs::create_directory(options.folder);
  Sentences said;
  Recorder recorder(options, kSmall, RecordingHeader{}, said.log());
  Source source(recorder, kSmall);
  source.add_all(0, 100);
  ASSERT_TRUE(eventually([&] { return settled(recorder, 100); }));
  fs::rename(options.folder, scratch / "yesterday");
  ASSERT_TRUE(eventually([&] { return !said.with("was moved while it was recorded").empty(); }));
  source.add_all(100, 110);  // There is no folder for these.
  ASSERT_TRUE(eventually([&] { return recorder.counts().stopped; }));
  EXPECT_EQ(said.with("is gone; it goes on by itself").size(), 1U);
  fs::create_directory(options.folder);
  std::int64_t next = 110;
  ASSERT_TRUE(eventually([&] {
    source.add(next++);
    return !recorder.counts().stopped;
  }));
  const RecorderCounts counts = recorder.finish();
  EXPECT_EQ(counts.recorded + counts.dropped, next);
  EXPECT_EQ(joined(recorded(scratch / "yesterday")), numbers(0, 100));
  const std::vector<std::int64_t> after = joined(recorded(options.folder));
  EXPECT_EQ(counts.recorded, 100 + static_cast<std::int64_t>(after.size()));
  EXPECT_GT(after.size(), 0U);
}

TEST(Recorder, ANewHeaderBeginsANewFile) {
  const ScratchDirectory scratch;
  Sentences said;
  RecordingHeader header;
  header.optics.wavelength_m = 500e-9;
  header.provenance.sensor_hash = "first";
  header.provenance.history = {"method = \"circulation\""};
  {
    Recorder recorder(options_for(scratch, RecordMode::kContinuous), kSmall, header, said.log());
    Source source(recorder, kSmall);
    source.add_all(0, 20);
    ASSERT_TRUE(eventually([&] { return settled(recorder, 20); }));
    recorder.describe(header);  // It is the same.
    source.add_all(20, 40);
    ASSERT_TRUE(eventually([&] { return settled(recorder, 40); }));
    header.optics.wavelength_m = 700e-9;
    header.provenance.sensor_hash = "second";
    recorder.describe(header);
    source.add_all(40, 60);
  }
  const auto files = recorded(scratch.path());
  ASSERT_EQ(files.size(), 2U);
  EXPECT_EQ(files.begin()->second, numbers(0, 40));
  EXPECT_EQ(files.rbegin()->second, numbers(40, 60));
  const std::string expected[] = {"first", "second"};
  int i = 0;
  for (const auto& [name, frames] : files) {
    FitsFile file = FitsFile::open(scratch / name);
    EXPECT_EQ(file.key_string("SENSHASH"), expected[i]);
    EXPECT_EQ(file.key_double("WAVELEN"), i == 0 ? 500e-9 : 700e-9);
    // The first frame came 1 800 000 000 s after 1970.
    EXPECT_EQ(file.key_string("DATE-OBS"),
              i == 0 ? "2027-01-15T08:00:00.000" : "2027-01-15T08:00:00.040");
    EXPECT_EQ(file.history(), header.provenance.history);
    ++i;
  }
}

TEST(Recorder, OnlyAVortexAsProbableAndAsTrackedAsAskedForIsATrigger) {
  const ScratchDirectory scratch;
  RecorderOptions options = options_for(scratch, RecordMode::kTrigger);
  options.before_s = options.after_s = 0.0;
  options.trigger_on_vortex = options.trigger_tracked_only = true;
  options.trigger_min_probability = 0.9;
  Sentences said;
  FrameBuffer frame(kSmall);
  {
    Recorder recorder(options, kSmall, RecordingHeader{}, said.log());
    const auto add = [&](std::int64_t sequence, float probability, std::int64_t track) {
      VortexList vortices(1);
      Vortex vortex;
      vortex.x = 4.25F;
      vortex.y = 6.5F;
      vortex.charge = -1;
      vortex.probability = probability;
      vortex.track = track;
      vortices.push(vortex);
      fill_numbered(frame, sequence);
      recorder.add(frame, &vortices);
    };
    add(0, 0.89F, 3);
    add(1, 0.95F, -1);
    add(2, kUnknownProbability, 3);
    add(3, 0.95F, 17);
    add(4, 0.5F, 17);
  }
  EXPECT_EQ(joined(recorded(scratch.path())), numbers(3, 4));
  EXPECT_EQ(said.with("the trigger is a vortex of charge -1 at (4.25, 6.50), probability 0.950, "
                      "track 17")
                .size(),
            1U);
}

TEST(Recorder, RefusesAFolderItCannotWriteTo) {
  const ScratchDirectory scratch;
  RecorderOptions options = options_for(scratch, RecordMode::kContinuous);
  options.folder = scratch / "missing";
  const auto refusal = [&](const FrameFormat& format) {
    return failure_text([&] { Recorder(options, format, RecordingHeader{}, [](auto&) {}); });
  };
  EXPECT_NE(refusal(kSmall).find("missing"), std::string::npos);
  options.folder = scratch.path();
  FrameFormat scaled = kSmall;
  scaled.zero_adu = -100.0;
  EXPECT_NE(refusal(scaled).find("ADU"), std::string::npos);
  EXPECT_EQ(refusal(kSmall), "");
}

/// Limits the size of files while it lives. Writes beyond the limit fail as on a full disk.
class FileSizeLimit {
 public:
  explicit FileSizeLimit(rlim_t bytes) : handler_(signal(SIGXFSZ, SIG_IGN)) {
    getrlimit(RLIMIT_FSIZE, &before_);
    const rlimit limit{bytes, before_.rlim_max};
    setrlimit(RLIMIT_FSIZE, &limit);
  }
  ~FileSizeLimit() {
    setrlimit(RLIMIT_FSIZE, &before_);
    signal(SIGXFSZ, handler_);
  }
  FileSizeLimit(const FileSizeLimit&) = delete;
  FileSizeLimit& operator=(const FileSizeLimit&) = delete;

 private:
  rlimit before_{};
  void (*handler_)(int);
};

TEST(Recorder, StopsAtAWriteErrorWithOneSentence) {
  const ScratchDirectory scratch;
  Sentences said;
  Recorder recorder(options_for(scratch, RecordMode::kContinuous), kSmall, RecordingHeader{},
                    said.log());
  Source source(recorder, kSmall);
  source.add_all(0, 100);
  ASSERT_TRUE(eventually([&] { return recorder.counts().recorded == 100; }));
  {
    const FileSizeLimit limit(2'000'000);
    source.add_all(100, 500);
    ASSERT_TRUE(eventually([&] { return settled(recorder, source.added()); }));
  }
  source.add_all(500, 600);
  ASSERT_TRUE(eventually([&] { return settled(recorder, source.added()); }));
  EXPECT_TRUE(recorder.counts().stopped);
  EXPECT_GE(recorder.counts().recorded, 100);
  EXPECT_LT(recorder.counts().recorded, 200);
  const auto sentences = said.with("recording stopped");
  ASSERT_EQ(sentences.size(), 1U);
  EXPECT_NE(sentences[0].find("File too large"), std::string::npos) << sentences[0];
  EXPECT_EQ(joined(recorded(scratch.path())), numbers(0, recorder.counts().recorded));
}

/// Mounts a disk of 16 MB on a directory, while it lives.
class SmallDisk {
 public:
  explicit SmallDisk(std::string directory) : directory_(std::move(directory)) {
    fs::create_directory(directory_);
    mounted_ = run("mount -t tmpfs -o size=16m none");
  }
  ~SmallDisk() {
    if (mounted_) {
      EXPECT_TRUE(run("umount"));
    }
  }
  SmallDisk(const SmallDisk&) = delete;
  SmallDisk& operator=(const SmallDisk&) = delete;
  bool mounted() const { return mounted_; }

 private:
  bool run(const std::string& command) const {
    return std::system((command + " '" + directory_ + "' 2>/dev/null").c_str()) == 0;
  }

  std::string directory_;
  bool mounted_ = false;
};

TEST(Recorder, StopsBeforeTheDiskIsFullAndGoesOnWhenThereIsRoom) {
  const ScratchDirectory scratch;
  const std::string disk = scratch / "disk";
  const SmallDisk small(disk);
  if (!small.mounted()) GTEST_SKIP() << "this user may not mount a small tmpfs";
  Sentences said;
  std::int64_t first_part = 0;
  {
    RecorderOptions options = options_for(scratch, RecordMode::kContinuous);
    options.folder = disk;
    options.min_free_mb = 2;
    options.memory_mb = 1;
    const std::string ballast = disk + "/ballast";
    write_bytes(ballast, std::string(5'000'000, 'x'));
    Recorder recorder(options, kSmall, RecordingHeader{}, said.log());
    Source source(recorder, kSmall);
    ASSERT_TRUE(eventually([&] {
      for (int i = 0; i < 20; ++i) source.add(source.added());
      return recorder.counts().stopped;
    }));
    source.add_all(source.added(), source.added() + 100);
    ASSERT_TRUE(eventually([&] { return settled(recorder, source.added()); }));
    EXPECT_TRUE(recorder.counts().stopped);
    first_part = recorder.counts().recorded;
    EXPECT_GT(first_part, 500);
    EXPECT_LT(first_part, 1000);
    const auto left = fs::space(disk).available;
    EXPECT_GE(left, 2'000'000U);
    EXPECT_LT(left, 2'100'000U) << "it must not stop too early either";
    ASSERT_EQ(said.with("recording stopped").size(), 1U);
    EXPECT_NE(said.with("recording stopped")[0].find(disk), std::string::npos);
    EXPECT_EQ(FitsSource({said.with("recording to")[0].substr(13)}).frame_count(), first_part);

    fs::remove(ballast);
    EXPECT_TRUE(eventually([&] {
      source.add(source.added());
      return !recorder.counts().stopped;
    }));
    source.add_all(source.added(), source.added() + 100);
    ASSERT_TRUE(eventually([&] { return settled(recorder, source.added()); }));
    EXPECT_GE(recorder.counts().recorded, first_part + 50);
    EXPECT_EQ(said.with("recording goes on").size(), 1U);
  }
  const auto files = recorded(disk);
  EXPECT_EQ(files.size(), 2U);
}

/// The program record_forever, from its start to its death.
class Recording {
 public:
  explicit Recording(std::string folder) : folder_(std::move(folder)) {
    fs::create_directory(folder_);
    child_ = fork();
    if (child_ != 0) return;
    const int out = open((folder_ + ".txt").c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0666);
    dup2(out, STDOUT_FILENO);
    execl(kRecordForever, kRecordForever, folder_.c_str(), nullptr);
    _exit(127);
  }
  void kill_it() {
    kill(child_, SIGKILL);
    int status = 0;
    waitpid(child_, &status, 0);
    EXPECT_TRUE(WIFSIGNALED(status)) << "the program must not end by itself";
    std::ifstream lines(folder_ + ".txt");
    std::int64_t n = 0;
    std::int64_t time_us = 0;
    while (lines >> n >> time_us) handed_in_us_.push_back(time_us);
    if (!lines.eof()) lines.clear();
  }
  const std::string& folder() const { return folder_; }
  std::int64_t handed_in() const { return static_cast<std::int64_t>(handed_in_us_.size()); }
  /// Returns how many frames must be there: all but those of the last second, and of the longest
  /// time that this machine let the program wait.
  std::int64_t at_least() const {
    if (handed_in_us_.empty()) return 0;
    std::int64_t pause_us = 0;
    for (std::size_t i = 1; i < handed_in_us_.size(); ++i) {
      pause_us = std::max(pause_us, handed_in_us_[i] - handed_in_us_[i - 1]);
    }
    return std::count_if(handed_in_us_.begin(), handed_in_us_.end(), [&](std::int64_t time_us) {
      return time_us < handed_in_us_.back() - 1'000'000 - pause_us;
    });
  }

 private:
  std::string folder_;
  pid_t child_ = -1;
  std::vector<std::int64_t> handed_in_us_;
};

// In each of fifty lives every file opens, every pixel in it is right, and at most the last second
// is missing.
TEST(Recorder, SurvivesKillMinus9) {
#if defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "under TSan most lives end before the program has begun; ASan runs this test";
#endif
  constexpr unsigned kSeed = 20261123;
  SCOPED_TRACE(kSeed);
  std::mt19937 random(kSeed);
  std::uniform_int_distribution<int> life_ms(50, 1900);
  const ScratchDirectory scratch;
  std::vector<Recording> recordings;
  constexpr int kTogether = 5;
  for (int batch = 0; batch < 10; ++batch) {
    std::vector<int> lives;
    for (int i = 0; i < kTogether; ++i) lives.push_back(life_ms(random));
    std::sort(lives.begin(), lives.end());
    const auto start = std::chrono::steady_clock::now();
    for (int i = 0; i < kTogether; ++i) {
      recordings.emplace_back(scratch / ("run" + std::to_string(recordings.size() + 100)));
    }
    for (int i = 0; i < kTogether; ++i) {
      std::this_thread::sleep_until(start + std::chrono::milliseconds(lives[size_t(i)]));
      recordings[recordings.size() - kTogether + static_cast<std::size_t>(i)].kill_it();
    }
  }

  std::map<std::string, std::int64_t> found_frames;  // by folder
  const PeerAnswer answer = ask_astropy("recordings", scratch.path());
  const bool has_astropy = answer.exit_code != 77;
  if (has_astropy) {
    ASSERT_EQ(answer.exit_code, 0) << answer.text;
    for (const FoundRecording& found : found_recordings(answer)) {
      const std::string folder = found.name.substr(0, found.name.find('/'));
      EXPECT_EQ(found_frames[folder] % 400, 0) << found.name << ": the file before it is not whole";
      if (found.rows >= 0) {
        EXPECT_EQ(found.wrong, 0) << found.name;
        EXPECT_EQ(found.first, found_frames[folder]) << found.name;
        EXPECT_EQ(found.last, found.first + found.frames - 1) << found.name;
      }
      found_frames[folder] += found.frames;
    }
  }
  std::int64_t needed = 0;
  int with_files = 0;
  for (const Recording& recording : recordings) {
    std::int64_t replayed = 0;
    std::vector<fs::path> paths;
    for (const auto& entry : fs::directory_iterator(recording.folder())) {
      if (entry.path().extension() == ".fits") paths.push_back(entry.path());
    }
    std::sort(paths.begin(), paths.end());
    for (const fs::path& path : paths) {
      FitsSource source({path.string()});
      FrameBuffer frame(source.format());
      while (source.next(frame) == Delivery::kFrame) {
        ASSERT_TRUE(is_numbered(frame, replayed)) << path << " frame " << replayed;
        ++replayed;
      }
    }
    if (!paths.empty()) ++with_files;
    // One may not be printed yet.
    EXPECT_LE(replayed, recording.handed_in() + 1) << recording.folder();
    EXPECT_GE(replayed, recording.at_least()) << recording.folder();
    needed += recording.at_least();
    if (has_astropy) {
      EXPECT_EQ(replayed, found_frames[fs::path(recording.folder()).filename().string()]);
    }
  }
  EXPECT_GT(with_files, 10) << "most must have lived until their first file";
  // Under a sanitizer on a busy machine a program may wait for seconds, and little must be there.
  EXPECT_GE(needed, kSanitized ? 0 : 300) << "some must have lived longer than a second";
  if (!has_astropy) GTEST_SKIP() << "replayed, but astropy is not installed";
}

}  // namespace
}  // namespace curlew
