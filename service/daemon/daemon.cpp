// The daemon's supervising thread: signals, reload, status, the service manager.
#include "service/daemon/daemon.h"

#include <spdlog/spdlog.h>

#include <nlohmann/json.hpp>
#include <thread>
#include <utility>

#include "acquisition/open_camera.h"
#include "acquisition/usb/usb_watcher.h"
#include "core/error.h"
#include "service/program/interrupt.h"
#include "service/sensor/sensor_file.h"
#include "service/sensor/simulated_sensor.h"

namespace curlew {
namespace {

using Clock = std::chrono::steady_clock;

constexpr int kTickMs = 100;
constexpr int kCleanSecondsToRecover = 3;
constexpr int kQuietSeconds = 3;  // without results, until the status says so
constexpr auto kLongestSilence = std::chrono::seconds(20);  // of a live connecting thread

bool is_simulated(const Config& config) { return config.camera.source.rfind("sim:", 0) == 0; }

Sensor sensor_for(const Config& config) {
  if (!config.daemon.sensor.empty()) return read_sensor(config.daemon.sensor);
  if (is_simulated(config)) return simulated_sensor(config.centroid);
  throw UsageError(
      "no sensor file: give --sensor, or sensor in section [daemon] of the configuration; "
      "'curlew calibrate' makes one");
}

}  // namespace

const char* name_of(DaemonState state) {
  switch (state) {
    case DaemonState::kSearching:
      return "searching";
    case DaemonState::kOpening:
      return "opening";
    case DaemonState::kStreaming:
      return "streaming";
    case DaemonState::kDegraded:
      return "degraded";
    case DaemonState::kLost:
      return "lost";
    case DaemonState::kStopping:
      return "stopping";
  }
  return "";
}

Daemon::Daemon(std::function<Config()> configure, DaemonLimits limits)
    : configure_(std::move(configure)),
      limits_(limits),
      started_(Clock::now()),
      config_(configure_()),
      sensor_(sensor_for(config_)),
      placement_(config_.pipeline.cpus, config_.realtime.priority) {
  const DaemonOptions& daemon = config_.daemon;
  if (!daemon.jsonl.empty())
    writer_ = std::make_unique<ResultWriter>(daemon.jsonl, config_.pipeline.max_vortices);
  if (!daemon.control.empty()) control_socket_ = std::make_unique<ControlSocket>(daemon.control);
}

Daemon::~Daemon() = default;

DaemonReport Daemon::run() {
  spdlog::info("state={} {}", name_of(state_), config_.camera.source);
  std::unique_ptr<UsbWatcher> usb;
  try {
    if (comes_and_goes(config_.camera))
      usb = std::make_unique<UsbWatcher>([this](UsbChange change) {
        if (change == UsbChange::kArrived) wake();
      });
  } catch (const Failure& failure) {
    spdlog::warn("{}; arrivals are noticed later", failure.what());  // a network camera needs none
  }
  std::thread connecting([this] {
    try {
      connect_until_stopped();
    } catch (...) {
      const std::lock_guard lock(mutex_);
      fatal_ = std::current_exception();
    }
    const std::lock_guard lock(mutex_);
    finished_ = true;
  });
  std::exception_ptr failure;
  try {
    supervisor_.ready("searching");
    supervise();
  } catch (...) {
    failure = std::current_exception();
    request_stop();
  }
  connecting.join();
  if (recorder_) recorder_->finish();
  DaemonReport report = report_so_far();
  if (writer_) report.unwritten = writer_->finish();
  if (fatal_) std::rethrow_exception(fatal_);
  if (failure) std::rethrow_exception(failure);
  return report;
}

void Daemon::supervise() {
  auto second = Clock::now() + std::chrono::seconds(1);
  auto last_sign = Clock::now();
  std::int64_t seen_signs = -1;
  bool finished = false;
  bool stopping = false;
  while (!finished) {
    if (control_socket_)
      control_socket_->serve(kTickMs, [this](const std::string& word) { return answer(word); });
    else
      std::this_thread::sleep_for(std::chrono::milliseconds(kTickMs));
    if (interrupted() || Clock::now() - started_ > std::chrono::duration<double>(limits_.seconds))
      request_stop();
    if (!stopping && control_.stop) {
      stopping = true;
      supervisor_.stopping();
    }
    if (take_reload_request()) reload();
    if (take_trigger_request()) spdlog::info("recorder: {}", answer("trigger"));
    adopt_pending_plan();
    const std::int64_t signs = control_.signs_of_life;
    if (std::exchange(seen_signs, signs) != signs) last_sign = Clock::now();
    if (Clock::now() - last_sign < kLongestSilence) supervisor_.watchdog();
    if (Clock::now() >= second) {
      every_second();
      second += std::chrono::seconds(1);
    }
    const std::lock_guard lock(mutex_);
    finished = finished_;
  }
}

/// Reads configuration and sensor file again. What is wrong with them is said, and nothing changes.
void Daemon::reload() {
  supervisor_.reloading();
  try {
    Config config = configure_();
    Sensor sensor = sensor_for(config);
    {
      const std::lock_guard lock(mutex_);
      Config rest = config;
      rest.daemon.sensor = config_.daemon.sensor;  // is taken up
      for (const std::string& section : changed_sections(config_, rest))
        if (section == "pipeline" || section == "realtime" || section == "recorder" ||
            section == "daemon")
          spdlog::warn("reload: [{}] takes effect when curlew is started again", section);
        else if (section == "camera" || section == "usb")
          spdlog::info("reload: [{}] takes effect when the camera is connected again", section);
      config.pipeline = config_.pipeline;
      config.realtime = config_.realtime;
      config.recorder = config_.recorder;
    }
    std::unique_lock lock(mutex_);
    std::optional<FrameFormat> format;
    std::shared_ptr<const Plan> plan;
    do {  // again where another camera was connected meanwhile
      format = format_;
      lock.unlock();
      if (format) plan = std::make_shared<const Plan>(sensor, *format, config);
      lock.lock();
    } while (format != format_);
    if (!format) plan.reset();
    ++configurations_;
    config_ = std::move(config);
    sensor_ = std::move(sensor);
    pending_plan_ = std::move(plan);
    spdlog::info("reload: configuration {} and sensor file are in use", config_hash(config_));
  } catch (const std::exception& error) {
    spdlog::error("reload: {}; the old plan stays", error.what());
  }
  supervisor_.ready("reloaded");
}

void Daemon::adopt_pending_plan() {
  const std::lock_guard lock(mutex_);
  if (pending_plan_ && pipeline_ && pipeline_->adopt(pending_plan_)) pending_plan_.reset();
}

void Daemon::every_second() {
  DaemonStatus status;
  FrameCounts now;
  {
    const std::lock_guard lock(mutex_);
    const DaemonReport report = report_so_far();
    status.frames = report.frames;
    status.superseded = report.superseded;
    status.recorder = report.recorder;
    status.recording = recorder_ != nullptr;
    tell_refusals(placement_.refused());
  }
  status.results = results_;
  // A window ends with a frame, so a second may pass without one.
  if (statistics_.take(status.window))
    quiet_seconds_ = 0;
  else if (++quiet_seconds_ < kQuietSeconds)
    status.window = last_window_;
  last_window_ = status.window;
  if (status.window.frames > 0)
    status.frames_per_s = static_cast<double>(status.window.frames) / status.window.seconds;
  judge(status.frames, status.superseded, status.window);
  {
    const std::lock_guard lock(mutex_);
    status.state = name_of(state_);
  }
  printer_.add(status);
  supervisor_.status(status_line(status));
}

/// Streaming or degraded, by what the last seconds were like.
void Daemon::judge(const FrameCounts& counts, std::int64_t superseded, const StatusWindow& window) {
  const std::int64_t dropped = counts.dropped() - judged_counts_.dropped();
  const std::int64_t passed_over = superseded - judged_superseded_;
  judged_counts_ = counts;
  judged_superseded_ = superseded;
  const bool clean = dropped == 0 && passed_over == 0 && window.late == 0;
  clean_seconds_ = clean ? clean_seconds_ + 1 : 0;
  if (!clean)
    set_state(DaemonState::kDegraded,
              fmt::format("{} frames lost or damaged, {} superseded, {} late in a second", dropped,
                          passed_over, window.late),
              DaemonState::kStreaming);
  else if (clean_seconds_ >= kCleanSecondsToRecover)
    set_state(DaemonState::kStreaming, "", DaemonState::kDegraded);
}

/// The words of `curlew control`.
std::string Daemon::answer(const std::string& word) {
  const std::unique_lock lock(mutex_);
  if (word == "status") {
    const DaemonReport report = report_so_far();
    nlohmann::ordered_json json;
    json["state"] = name_of(state_);
    json["reason"] = state_reason_;
    json["results"] = results_.load();
    json["delivered"] = report.frames.delivered;
    json["superseded"] = report.superseded;
    json["lost"] = report.frames.lost;
    json["incomplete"] = report.frames.incomplete;
    json["dropped"] = report.frames.dropped();
    json["connections"] = report.connections;
    json["recorded"] = report.recorder.recorded;
    json["unrecorded"] = report.recorder.dropped;
    // What a camera calls itself need not be UTF-8.
    return json.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
  }
  if (word == "trigger") {
    if (!recorder_ || config_.recorder.mode != RecordMode::kTrigger)
      return "error: set mode = \"trigger\" in section [recorder] to record on a trigger";
    recorder_->trigger();
    return "triggered";
  }
  if (word == "expose") {
    if (camera_ == nullptr) return "error: no camera is streaming";
    try {
      camera_->trigger();
      return "exposed";
    } catch (const std::exception& error) {
      return std::string("error: ") + error.what();
    }
  }
  return "error: status, trigger and expose are known, not '" + word + "'";
}

void Daemon::tell_refusals(const std::vector<std::string>& sentences) {
  const std::lock_guard lock(refusals_mutex_);
  for (const std::string& sentence : sentences)
    if (told_refusals_.insert(sentence).second) spdlog::warn("{}", sentence);
}

void Daemon::set_state(DaemonState state, const std::string& reason,
                       std::optional<DaemonState> only_from) {
  const std::lock_guard lock(mutex_);
  if (only_from && state_ != *only_from) return;
  if (state == state_ && reason == state_reason_) return;
  // A camera that is not there would fill the log with attempts.
  const bool again =
      told_of_opening_ && (state == DaemonState::kOpening ||
                           (state == DaemonState::kSearching && state_ == DaemonState::kOpening));
  if (state == DaemonState::kOpening) told_of_opening_ = true;
  if (state == DaemonState::kStreaming) told_of_opening_ = false;
  state_ = state;
  state_reason_ = reason;
  spdlog::log(again ? spdlog::level::debug : spdlog::level::info, "state={}{}{}", name_of(state),
              reason.empty() ? "" : " ", reason);
}

void Daemon::request_stop() {
  control_.stop = true;
  {
    const std::lock_guard lock(mutex_);
    if (exchange_ != nullptr) exchange_->close();  // who waits for a frame waits no longer
  }
  wake();
}

void Daemon::wake() {
  {
    const std::lock_guard lock(mutex_);
    wake_up_ = true;
  }
  woken_.notify_all();
}

/// Needs the mutex.
DaemonReport Daemon::report_so_far() const {
  DaemonReport report = totals_;
  if (camera_ != nullptr) report.frames += camera_->counts();
  if (exchange_ != nullptr) report.superseded += exchange_->superseded();
  if (recorder_) report.recorder += recorder_->counts();
  return report;
}

}  // namespace curlew
