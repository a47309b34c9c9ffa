#include "service/daemon/daemon_connection.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <chrono>
#include <string>
#include <utility>

#include "acquisition/open_camera.h"
#include "core/error.h"
#include "service/program/interrupt.h"

namespace curlew {
namespace {

using Clock = std::chrono::steady_clock;

constexpr double kFirstPauseS = 0.1;

std::string reason_of(LiveFeed::End end, const Camera& camera, const CameraOptions& options) {
  if (end != LiveFeed::End::kTimedOut) return camera.failure();
  return fmt::format("no frame for {:.3g} s from {}; set timeout_s = 0 in [camera] if it may rest",
                     longest_silence_s(options), camera.description());
}

}  // namespace

void DaemonConnection::run() {
  double pause_s = kFirstPauseS;
  std::string complaint;  // The last one is kept, so that it is not logged again and again.
  while (!control_.stop) {
    ++control_.signs_of_life;
    const Config config = pipeline_.config();
    try {
      status_.enter(DaemonState::kSearching, "");
      const bool had_frames = connect(config);
      complaint.clear();
      if (had_frames) pause_s = kFirstPauseS;
    } catch (const Failure& failure) {
      if (interrupted()) break;  // Opening was given up for it.
      if (!comes_and_goes(config.camera)) throw;
      if (failure.what() != complaint) spdlog::warn("{}", failure.what());
      complaint = failure.what();
    } catch (const UsageError& error) {
      // After the first connection it is a reload that went wrong, and another may mend it.
      if (status_.snapshot().counts.connections == 0) throw;
      if (error.what() != complaint) spdlog::error("{}", error.what());
      complaint = error.what();
    }
    if (control_.stop) break;
    pause(pause_s);
    pause_s = std::min(2.0 * pause_s, config.camera.max_backoff_s);
  }
  status_.enter(DaemonState::kStopping, "");
}

/// Opens the camera and streams until it is lost. Returns whether it gave any frame.
bool DaemonConnection::connect(const Config& config) {
  const StatusSnapshot before = status_.snapshot();
  status_.enter(DaemonState::kOpening, config.camera.source);
  const auto enter_camera_thread = [this, realtime = config.realtime] {
    status_.refused(
        enter_realtime("curlew-camera", realtime.camera_cpus, realtime.camera_priority));
  };
  const std::unique_ptr<Camera> camera = open_camera(config.camera, enter_camera_thread);
  const std::string opened = fmt::format("{}: {} x {} px", camera->description(),
                                         camera->format().cols, camera->format().rows);
  if (std::exchange(opened_, opened) != opened) spdlog::info("{}", opened);
  try {
    pipeline_.prepare(camera->format());
  } catch (const Failure& failure) {
    // Before the first connection it is the configuration that is wrong, and waiting mends nothing.
    if (before.counts.connections == 0) throw UsageError(failure.what());
    throw;
  }
  status_.camera_opened();
  stream(*camera, config);
  return status_.snapshot().results > before.results;
}

void DaemonConnection::stream(Camera& camera, const Config& config) {
  FrameExchange exchange(
      camera.format(), config.pipeline.slots + 1 + static_cast<std::size_t>(config.camera.buffers));
  if (!realtime_) {
    realtime_ = std::make_unique<ProcessRealtime>(config.realtime);
    for (const std::string& got : realtime_->got()) spdlog::info("{}", got);
    status_.refused(realtime_->refused());
  }
  const auto settle_accounts = [&] {
    set_streaming(nullptr, nullptr);
    status_.stream_ended(camera, exchange);
  };
  try {
    const Streaming streaming(camera, exchange);
    set_streaming(&camera, &exchange);
    status_.stream_began(camera, exchange);
    for (const std::string& note : camera.notes()) spdlog::info("{}", note);
    status_.enter(DaemonState::kStreaming, camera.description());
    opened_.clear();
    const LiveFeed::End end = run_pipeline(exchange, config);
    const bool again = take_reconnect_request();
    const bool over = end == LiveFeed::End::kClosed && camera.failure().empty() && !again;
    if (over || end == LiveFeed::End::kLimit) stop();
    if (control_.stop)
      status_.enter(DaemonState::kStopping, "");
    else
      status_.enter(DaemonState::kLost, again ? "it is connected again with other settings"
                                              : reason_of(end, camera, config.camera));
  } catch (...) {
    settle_accounts();
    throw;
  }
  settle_accounts();
  // A recording or a simulation would begin with its first frame again, and fail again.
  if (!camera.failure().empty() && !comes_and_goes(config.camera)) throw Failure(camera.failure());
}

LiveFeed::End DaemonConnection::run_pipeline(FrameExchange& exchange, const Config& config) {
  // A recording that is played slowly is not lost.
  limits_.timeout_s = comes_and_goes(config.camera) ? longest_silence_s(config.camera) : 0.0;
  LiveFeed feed(exchange, limits_, control_);
  pipeline_.run(feed);
  limits_.first_index = feed.next_index();
  return feed.end();
}

// It gives signs of life, so that the watchdog does not take a long pause for a hang.
void DaemonConnection::pause(double seconds) {
  const auto end = Clock::now() + std::chrono::duration_cast<Clock::duration>(
                                      std::chrono::duration<double>(seconds));
  std::unique_lock lock(mutex_);
  while (!wake_up_ && !control_.stop && Clock::now() < end) {
    ++control_.signs_of_life;
    woken_.wait_until(lock, std::min(end, Clock::now() + std::chrono::seconds(1)));
  }
  wake_up_ = false;
}

void DaemonConnection::set_streaming(Camera* camera, FrameExchange* exchange) {
  const std::lock_guard lock(mutex_);
  camera_ = camera;
  exchange_ = exchange;
}

void DaemonConnection::stop() {
  control_.stop = true;
  {
    const std::lock_guard lock(mutex_);
    if (exchange_ != nullptr) exchange_->close();  // The pipeline need not wait for a frame.
  }
  wake();
}

void DaemonConnection::wake() {
  {
    const std::lock_guard lock(mutex_);
    wake_up_ = true;
  }
  woken_.notify_all();
}

void DaemonConnection::reconnect() {
  const std::lock_guard lock(mutex_);
  if (exchange_ == nullptr) return;  // The next connection has the settings anyway.
  reconnecting_ = true;
  exchange_->close();
}

bool DaemonConnection::take_reconnect_request() {
  const std::lock_guard lock(mutex_);
  return std::exchange(reconnecting_, false);
}

void DaemonConnection::expose() {
  const std::lock_guard lock(mutex_);
  if (camera_ == nullptr) throw Failure("no camera is streaming");
  camera_->trigger();
}

double DaemonConnection::exposure_us() {
  const std::lock_guard lock(mutex_);
  if (camera_ == nullptr) throw Failure("no camera is streaming");
  return camera_->exposure_us();
}

double DaemonConnection::set_exposure_us(double exposure_us) {
  const std::lock_guard lock(mutex_);
  if (camera_ == nullptr) throw Failure("no camera is streaming");
  return camera_->set_exposure_us(exposure_us);
}

}  // namespace curlew
