// The daemon's connecting thread: find the camera, stream, find it again.
#include <spdlog/spdlog.h>

#include <algorithm>
#include <thread>

#include "core/error.h"
#include "service/daemon.h"
#include "service/version.h"

namespace curlew {
namespace {

using Clock = std::chrono::steady_clock;

constexpr double kFirstPauseS = 0.1;

std::string reason_of(LiveFeed::End end, const Camera& camera, double timeout_s) {
  if (end == LiveFeed::End::kTimedOut)
    return fmt::format("no frame for {:.3g} s from {}", timeout_s, camera.description());
  return camera.failure();
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
  prepare(camera->format());
  {
    const std::lock_guard lock(mutex_);
    ++totals_.connections;
  }
  const std::int64_t before = results_;
  stream(*camera, config);
  return results_ > before;
}

/// Plan, slots, recorder for frames of this format; kept from the last connection where they fit.
void Daemon::prepare(const FrameFormat& format) {
  const std::lock_guard lock(mutex_);
  const bool same =
      format_ && format_->rows == format.rows && format_->cols == format.cols &&
      format_->pixel_type == format.pixel_type && format_->offset_x_px == format.offset_x_px &&
      format_->offset_y_px == format.offset_y_px && format_->binning == format.binning;
  if (same && pipeline_) return;
  auto plan = std::make_shared<const Plan>(sensor_, format, config_);
  if (!placement_)
    placement_ =
        std::make_unique<ThreadPlacement>(config_.pipeline.cpus, config_.realtime.priority);
  pipeline_ =
      std::make_shared<Pipeline>(std::move(plan), config_.pipeline, placement_->thread_start());
  pending_plan_.reset();
  if (recorder_) totals_.recorder += recorder_->finish();
  recorder_.reset();
  if (config_.recorder.mode != RecordMode::kOff)
    recorder_ = std::make_unique<Recorder>(
        config_.recorder, format, sensor_.optics, sensor_.detector,
        [](const std::string& sentence) {
          const bool bad = sentence.rfind("recording stopped", 0) == 0;
          spdlog::log(bad ? spdlog::level::warn : spdlog::level::info, "{}", sentence);
        });
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
  {
    const Streaming streaming(camera, exchange);
    {
      const std::lock_guard lock(mutex_);
      camera_ = &camera;
      exchange_ = &exchange;
    }
    for (const std::string& note : camera.notes()) spdlog::info("{}", note);
    set_state(DaemonState::kStreaming, camera.description());
    end = run_pipeline(exchange, config);
    if (end == LiveFeed::End::kClosed || end == LiveFeed::End::kTimedOut)
      set_state(DaemonState::kLost, reason_of(end, camera, config.camera.timeout_s));
    else
      set_state(DaemonState::kStopping, "");
  }
  {
    const std::lock_guard lock(mutex_);
    camera_ = nullptr;
    exchange_ = nullptr;
    totals_.frames += camera.counts();
    totals_.superseded += exchange.superseded();
    totals_.unprocessed += exchange.delivered() - exchange.superseded() - (results_ - before);
  }
  const bool ended = end == LiveFeed::End::kClosed && camera.failure().empty();
  if (ended || end == LiveFeed::End::kLimit) request_stop();
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
  limits.timeout_s = config.camera.timeout_s;
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

void Daemon::pause(double seconds) {
  std::unique_lock lock(mutex_);
  woken_.wait_for(lock, std::chrono::duration<double>(seconds),
                  [this] { return wake_up_ || control_.stop.load(); });
  wake_up_ = false;
}

}  // namespace curlew
