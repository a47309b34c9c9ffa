#include "service/daemon/live_calibration.h"

#include <spdlog/spdlog.h>

#include <chrono>
#include <cstring>
#include <filesystem>
#include <utility>

#include "acquisition/fits/partial_path.h"
#include "acquisition/recording/mean_image.h"
#include "acquisition/recording/recording.h"
#include "core/error.h"
#include "core/utc_now.h"
#include "service/program/outputs.h"
#include "service/program/utc_name.h"
#include "service/program/version.h"
#include "service/sensor/frame_maps.h"
#include "service/sensor/recording_calibration.h"
#include "service/sensor/sensor_file.h"

namespace curlew {
namespace {

using Clock = std::chrono::steady_clock;

const char* name_of(LiveCalibration::Kind kind) {
  return kind == LiveCalibration::Kind::kDark ? "dark" : "reference";
}

/// A file that goes at the end of its scope.
class Scratch {
 public:
  explicit Scratch(std::string path) : path_(std::move(path)) {}
  ~Scratch() {
    std::error_code ignored;
    std::filesystem::remove(path_, ignored);
  }
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;
  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

/// Returns the name of a new file for what is taken now. Throws UsageError where there is one.
std::string new_file(const std::string& folder, const std::string& what) {
  std::string path =
      (std::filesystem::path(folder) / (what + "-" + utc_name(utc_now_ns()) + ".fits")).string();
  check_output(path, {}, Existing::kRefused);
  return path;
}

/// Throws Failure where the frames would leave less room on the disk than the recorder leaves.
void require_room(const RecorderOptions& recorder, std::int64_t frames, const FrameFormat& format) {
  std::error_code unknown;
  const auto space = std::filesystem::space(recorder.folder, unknown);
  if (unknown) return;
  const double left_mb = 1e-6 * (static_cast<double>(space.available) -
                                 static_cast<double>(frames) * static_cast<double>(format.bytes()));
  if (left_mb < static_cast<double>(recorder.min_free_mb))
    throw Failure(
        fmt::format("{} frames would leave {:.0f} MB free in {}, less than min_free_mb in "
                    "section [recorder]",
                    frames, left_mb, recorder.folder));
}

}  // namespace

LiveCalibration::LiveCalibration(DaemonPipeline& pipeline) : pipeline_(pipeline) {
  pipeline_.show_on(tap_);
}

void LiveCalibration::begin(Kind kind, std::int64_t frames, const std::string& asked_by) {
  constexpr std::int64_t kMost = 10'000;
  if (frames < 1 || frames > kMost)
    throw UsageError(fmt::format("frames must be a number from 1 to {}", kMost));
  const std::lock_guard lock(mutex_);
  if (stopping_) throw UsageError("curlew is stopping");
  if (working_) throw UsageError("wait until the frames before are taken: " + text_);
  if (thread_.joinable()) thread_.join();
  working_ = true;
  text_ = fmt::format("taking {} frames as {}", frames, name_of(kind));
  thread_ = std::thread([this, task = Task{kind, frames, asked_by}] { work(task); });
}

std::string LiveCalibration::text() const {
  const std::lock_guard lock(mutex_);
  return text_;
}

void LiveCalibration::stop() {
  stopping_ = true;
  std::thread thread;
  {
    const std::lock_guard lock(mutex_);
    thread = std::move(thread_);
  }
  if (thread.joinable()) thread.join();
}

void LiveCalibration::say(const std::string& text) {
  const std::lock_guard lock(mutex_);
  text_ = text;
}

void LiveCalibration::work(const Task& task) {
  try {
    const std::string folder = pipeline_.config().recorder.folder;
    const Scratch taken(partial_path((std::filesystem::path(folder) / "taken.fits").string()));
    const std::string frames = take(task, taken.path());
    say(frames + "; calibrating");
    const std::string done =
        task.kind == Kind::kDark ? use_dark(taken.path()) : use_reference(taken.path());
    spdlog::info("page: {} had a {} taken: {}; {}", task.asked_by, name_of(task.kind), frames,
                 done);
    say(fmt::format("{}; {}", frames, done));
  } catch (const std::exception& error) {
    const std::string text =
        fmt::format("no {} was taken, the old sensor stays: {}", name_of(task.kind), error.what());
    spdlog::warn("page: {} asked in vain: {}", task.asked_by, text);
    say(text);
  }
  working_ = false;
}

/// Writes copies of frames into a recording. Returns a sentence on them.
std::string LiveCalibration::take(const Task& task, const std::string& path) {
  constexpr auto kPatience = std::chrono::seconds(10);
  std::optional<RecordingWriter> recording;
  std::int64_t first = 0;
  std::int64_t last = 0;
  FrameFormat format;
  const Sensor sensor = pipeline_.sensor();
  auto came = Clock::now();
  tap_.answer();  // One that was asked for and has waited since is not of now.
  for (tap_.ask(); !recording || recording->frames() < task.frames;) {
    const FrameSample* sample = tap_.answer();
    if (stopping_) throw Failure("curlew is stopping");
    if (sample == nullptr) {
      if (Clock::now() - came > kPatience) throw Failure("no frame came within 10 s");
      std::this_thread::sleep_for(std::chrono::microseconds(500));
      continue;
    }
    if (!recording) {
      format = sample->format;
      Provenance provenance(kProgram);
      provenance.observed_ns = utc_now_ns();
      recording.emplace(path, format, sensor.optics, sensor.detector, provenance);
      first = sample->header.sequence;
      require_room(pipeline_.config().recorder, task.frames, format);
    }
    if (!(sample->format == format)) throw Failure("the camera's frames have changed meanwhile");
    recording->append({sample->pixels.data(), format.rows, format.cols, format.pixel_type},
                      sample->header);
    last = sample->header.sequence;
    came = Clock::now();
    if (recording->frames() < task.frames) tap_.ask();
  }
  recording->commit();
  return fmt::format("{} of the {} frames with sequence {} to {}", task.frames, last - first + 1,
                     first, last);
}

std::string LiveCalibration::use_dark(const std::string& taken) {
  const std::string sentence = check_dark("the stack", read_mean_image(taken));
  const std::string path = new_file(pipeline_.config().recorder.folder, "dark");
  std::filesystem::rename(taken, path);
  dark_ = path;
  return fmt::format("{}: {}, for the next reference", path, sentence);
}

std::string LiveCalibration::use_reference(const std::string& taken) {
  const Config config = pipeline_.config();
  const Sensor old = pipeline_.sensor();
  ReferenceFrameSet reference = read_reference_frames(taken, {});
  CalibrationInput& input = reference.input;
  input.dark_adu = old.dark_adu;
  if (!dark_.empty()) set_dark(read_map(dark_, reference.mean, {}), input);
  input.flat = old.flat;
  input.bad_pixel = old.bad_pixel;
  input.optics = old.optics;
  input.detector = old.detector;
  input.centroid = config.centroid;
  const RecordingCalibration fresh =
      calibrate_on_frames(taken, {}, std::move(input), "the frames taken");
  Provenance provenance = provenance_of(config);
  const std::string origin = "calibrated by the page on " + config.camera.source;
  provenance.history.insert(provenance.history.begin(), origin);
  const std::string path = new_file(config.recorder.folder, "sensor");
  write_sensor(path, fresh.calibration.sensor, provenance);
  for (const std::string& note : fresh.calibration.notes) spdlog::info("{}: {}", path, note);
  if (!fresh.dropped.empty()) spdlog::info("{}: {}", path, fresh.dropped);
  try {
    pipeline_.use_sensor(path);
  } catch (...) {
    std::filesystem::remove(path);
    throw;
  }
  const Sensor& sensor = fresh.calibration.sensor;
  return fmt::format(
      "{} of {} x {} lenslets lit, spots {:.3f} px rms from the grid; {} is in use until curlew "
      "ends "
      "or reloads; to keep it, name it as sensor in [daemon]",
      std::count(sensor.valid.begin(), sensor.valid.end(), std::uint8_t{1}), sensor.grid.cols,
      sensor.grid.rows, sensor.residual_px, path);
}

}  // namespace curlew
