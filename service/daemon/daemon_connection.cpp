// The daemon's connecting thread: find the camera, stream, find it again.
#include <spdlog/spdlog.h>

#include <algorithm>
#include <thread>

#include "acquisition/open_camera.h"
#include "core/error.h"
#include "service/daemon/daemon.h"
#include "service/program/version.h"

namespace curlew {
namespace {

using Clock = std::chrono::steady_clock;

constexpr double kFirstPauseS = 0.1;

std::string reason_of(LiveFeed::End end, const Camera& camera, const CameraOptions& options) {
  if (end != LiveFeed::End::kTimedOut) return camera.failure();
  return fmt::format("no frame for {:.3g} s from {}; set timeout_s = 0 in [camera] if it may rest",
                     longest_silence_s(options), camera.description());
}

void log_recorder(const std::string& sentence) {
  const bool bad = sentence.rfind("recording stopped", 0) == 0;
  spdlog::log(bad ? spdlog::level::warn : spdlog::level::info, "{}", sentence);
}

}  // namespace

void Daemon::connect_until_stopped() {
  double pause_s = kFirstPauseS;
  std::string complaint;  // the last one, so that it is not said again and again
  while (!control_.stop) {
    ++control_.signs_of_life;
    const Config config = current_config();
    try {
      set_state(DaemonState::kSearching, "");
      const bool had_frames = connect(config);
      complaint.clear();
      if (had_frames) pause_s = kFirstPauseS;
    } catch (const Failure& failure) {
      if (!comes_and_goes(config.camera)) throw;
      if (failure.what() != complaint) spdlog::warn("{}", failure.what());
      complaint = failure.what();
    } catch (const UsageError& error) {
      if (totals_.connections == 0) throw;  // from the start; not a reload that went wrong
      if (error.what() != complaint) spdlog::error("{}", error.what());
      complaint = error.what();
    }
    if (control_.stop) break;
    pause(pause_s);
    pause_s = std::min(2.0 * pause_s, config.camera.max_backoff_s);
  }
  set_state(DaemonState::kStopping, "");
}

/// One connection from opening to losing it. Returns whether it gave any frame.
bool Daemon::connect(const Config& config) {
  set_state(DaemonState::kOpening, config.camera.source);
  const std::unique_ptr<Camera> camera = open_camera(config.camera, [this,
                                                                     realtime = config.realtime] {
    tell_refusals(enter_realtime("curlew-camera", realtime.camera_cpus, realtime.camera_priority));
  });
  spdlog::info("{}: {} x {} px", camera->description(), camera->format().cols,
               camera->format().rows);
  try {
    prepare(camera->format());
  } catch (const Failure& failure) {
    // From the start it is the configuration that is wrong, and waiting mends nothing.
    if (totals_.connections == 0) throw UsageError(failure.what());
    throw;
  }
  {
    const std::lock_guard lock(mutex_);
    ++totals_.connections;
  }
  const std::int64_t before = results_;
  stream(*camera, config);
  return results_ > before;
}

/// Plan, slots, recorder for frames of this format; kept from the last connection where they fit.
/// What takes its time is done without the mutex, so that the supervisor is never kept waiting.
void Daemon::prepare(const FrameFormat& format) {
  std::unique_lock lock(mutex_);
  if (format_ == format) return;
  format_.reset();  // until all fits the new one
  pipeline_.reset();
  pending_plan_.reset();
  const std::unique_ptr<Recorder> old = std::move(recorder_);
  std::int64_t made_from = -1;
  std::shared_ptr<Pipeline> pipeline;
  std::unique_ptr<Recorder> recorder;
  RecorderCounts recorded;
  while (made_from != configurations_) {  // again where it was reloaded meanwhile
    made_from = configurations_;
    const Config config = config_;
    const Sensor sensor = sensor_;
    lock.unlock();
    if (old) recorded = old->finish();
    pipeline =
        std::make_shared<Pipeline>(std::make_shared<const Plan>(sensor, format, config),
                                   config.pipeline, placement_.thread_start(), totals_.connections);
    recorder.reset();
    if (config.recorder.mode != RecordMode::kOff)
      recorder = std::make_unique<Recorder>(config.recorder, format, sensor.optics, sensor.detector,
                                            log_recorder);
    lock.lock();
  }
  totals_.recorder += recorded;
  pipeline_ = std::move(pipeline);
  recorder_ = std::move(recorder);
  format_ = format;
}

void Daemon::stream(Camera& camera, const Config& config) {
  FrameExchange exchange(
      camera.format(), config.pipeline.slots + 1 + static_cast<std::size_t>(config.camera.buffers));
  if (!realtime_) {
    realtime_ = std::make_unique<ProcessRealtime>(config.realtime);
    for (const std::string& got : realtime_->got()) spdlog::info("{}", got);
    tell_refusals(realtime_->refused());
  }
  LiveFeed::End end{};
  const std::int64_t before = results_;
  const auto settle_accounts = [&] {
    const std::lock_guard lock(mutex_);
    camera_ = nullptr;
    exchange_ = nullptr;
    totals_.frames += camera.counts();
    totals_.superseded += exchange.superseded();
    totals_.unprocessed += exchange.delivered() - exchange.superseded() - (results_ - before);
  };
  try {
    const Streaming streaming(camera, exchange);
    {
      const std::lock_guard lock(mutex_);
      camera_ = &camera;
      exchange_ = &exchange;
    }
    for (const std::string& note : camera.notes()) spdlog::info("{}", note);
    set_state(DaemonState::kStreaming, camera.description());
    end = run_pipeline(exchange, config);
    const bool over = end == LiveFeed::End::kClosed && camera.failure().empty();
    if (over || end == LiveFeed::End::kLimit) request_stop();
    if (control_.stop)
      set_state(DaemonState::kStopping, "");
    else
      set_state(DaemonState::kLost, reason_of(end, camera, config.camera));
  } catch (...) {
    settle_accounts();
    throw;
  }
  settle_accounts();
  // It would begin with its first frame again, and fail again.
  if (!camera.failure().empty() && !comes_and_goes(config.camera)) throw Failure(camera.failure());
}

/// Runs it in a thread of its own, so that its CPU and priority do not pass on to threads that are
/// begun later.
LiveFeed::End Daemon::run_pipeline(FrameExchange& exchange, const Config& config) {
  LiveFeed::Limits limits;
  limits.first_index = next_index_;
  limits.end_index = limits_.frames;
  if (limits_.seconds < 1e9)
    limits.until = started_ + std::chrono::duration_cast<Clock::duration>(
                                  std::chrono::duration<double>(limits_.seconds));
  // A recording that is played slowly is not lost.
  limits.timeout_s = comes_and_goes(config.camera) ? longest_silence_s(config.camera) : 0.0;
  LiveFeed feed(exchange, limits, control_);
  const std::int64_t dropped_before = totals_.results.dropped;
  Publisher publisher;
  publisher.publish = [&](const FrameSlot& slot) {
    if (recorder_) recorder_->add(*slot.frame, !slot.vortices.empty());
  };
  publisher.finish = [&](const FrameSlot& slot, std::int64_t dropped) {
    if (writer_) writer_->add(slot, dropped_before + dropped);
    statistics_.add(slot);
    results_.fetch_add(1, std::memory_order_relaxed);
  };
  RunReport report;
  std::exception_ptr failure;
  std::thread frames([&] {
    try {
      report = pipeline_->run(feed, publisher);
    } catch (...) {
      failure = std::current_exception();
    }
  });
  frames.join();
  next_index_ = feed.next_index();
  const std::lock_guard lock(mutex_);
  totals_.results.merge(report);
  if (failure) std::rethrow_exception(failure);
  return feed.end();
}

Config Daemon::current_config() const {
  const std::lock_guard lock(mutex_);
  return config_;
}

/// Gives signs of life: a long pause is no reason for the watchdog to bite.
void Daemon::pause(double seconds) {
  const auto end = Clock::now() + std::chrono::duration_cast<Clock::duration>(
                                      std::chrono::duration<double>(seconds));
  std::unique_lock lock(mutex_);
  while (!wake_up_ && !control_.stop && Clock::now() < end) {
    ++control_.signs_of_life;
    woken_.wait_until(lock, std::min(end, Clock::now() + std::chrono::seconds(1)));
  }
  wake_up_ = false;
}

}  // namespace curlew
