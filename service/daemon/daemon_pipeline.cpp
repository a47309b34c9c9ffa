#include "service/daemon/daemon_pipeline.h"

#include <spdlog/spdlog.h>

#include <exception>
#include <thread>
#include <utility>

#include "core/error.h"
#include "service/sensor/sensor_file.h"
#include "service/sensor/simulated_sensor.h"

namespace curlew {
namespace {

bool is_simulated(const Config& config) { return config.camera.source.rfind("sim:", 0) == 0; }

Sensor sensor_for(const Config& config) {
  if (!config.daemon.sensor.empty()) return read_sensor(config.daemon.sensor);
  if (is_simulated(config)) return simulated_sensor(config.centroid);
  throw UsageError(
      "no sensor file: give --sensor, or sensor in section [daemon] of the configuration; "
      "'curlew calibrate' makes one");
}

void log_method(const MethodChoice& choice) {
  if (const std::string line = method_line(choice); !line.empty()) spdlog::info("{}", line);
}

void log_recorder(const std::string& sentence) {
  const bool bad = sentence.rfind("recording stopped", 0) == 0;
  spdlog::log(bad ? spdlog::level::warn : spdlog::level::info, "{}", sentence);
}

/// Logs which of the changed sections have to wait, and for what. The sensor file need not wait,
/// although it stands in section [daemon].
void log_sections_that_wait(const Config& old, Config fresh) {
  fresh.daemon.sensor = old.daemon.sensor;
  for (const std::string& section : changed_sections(old, fresh))
    if (section == "pipeline" || section == "realtime" || section == "recorder" ||
        section == "daemon")
      spdlog::warn("reload: [{}] takes effect when curlew is started again", section);
    else if (section == "camera" || section == "usb")
      spdlog::info("reload: [{}] takes effect when the camera is connected again", section);
}

}  // namespace

DaemonPipeline::DaemonPipeline(std::function<Config()> configure, DaemonStatus& status)
    : configure_(std::move(configure)),
      status_(status),
      config_(configure_()),
      sensor_(sensor_for(config_)),
      placement_(config_.pipeline.cpus, config_.realtime.priority) {
  if (!config_.daemon.jsonl.empty())
    writer_ = std::make_unique<ResultWriter>(config_.daemon.jsonl, config_.pipeline.max_vortices);
}

Config DaemonPipeline::config() const {
  const std::lock_guard lock(mutex_);
  return config_;
}

// What takes long is done without the mutex, so that the supervising thread never waits for it.
void DaemonPipeline::prepare(const FrameFormat& format, std::int64_t connections_before) {
  std::unique_lock lock(mutex_);
  if (format_ == format) return;
  format_.reset();  // Until everything fits the new format a reload makes no plan.
  pipeline_.reset();
  pending_plan_.reset();
  const std::unique_ptr<Recorder> old = std::move(recorder_);
  lock.unlock();
  if (old) {
    old->finish();
    status_.recorder_ended(*old);
  }
  lock.lock();
  std::int64_t made_from = -1;
  MethodChoice choice;
  std::unique_ptr<Pipeline> pipeline;
  std::unique_ptr<Recorder> recorder;
  while (made_from != configurations_) {  // A reload meanwhile makes another round necessary.
    made_from = configurations_;
    const Config config = config_;
    const Sensor sensor = sensor_;
    lock.unlock();
    const auto plan = std::make_shared<const Plan>(sensor, format, config);
    choice = plan->detect.choice();
    pipeline = std::make_unique<Pipeline>(plan, config.pipeline, placement_.thread_start(),
                                          connections_before);
    recorder.reset();
    if (config.recorder.mode != RecordMode::kOff)
      recorder = std::make_unique<Recorder>(config.recorder, format, sensor.optics, sensor.detector,
                                            log_recorder);
    lock.lock();
  }
  pipeline_ = std::move(pipeline);
  recorder_ = std::move(recorder);
  format_ = format;
  if (recorder_) status_.recorder_began(*recorder_);
  log_method(choice);
}

// The pipeline runs in a thread of its own, so that its CPU and priority do not pass on to threads
// that this thread begins later.
void DaemonPipeline::run(LiveFeed& feed) {
  Publisher publisher;
  publisher.publish = [&](const FrameSlot& slot) {
    if (recorder_) recorder_->add(*slot.frame, !slot.vortices.empty());
  };
  publisher.finish = [&, dropped_before = report_.dropped](const FrameSlot& slot,
                                                           std::int64_t dropped) {
    if (writer_) writer_->add(slot, dropped_before + dropped);
    status_.result_published(slot);
  };
  std::exception_ptr failure;
  std::thread frames([&] {
    try {
      report_.merge(pipeline_->run(feed, publisher));
    } catch (...) {
      failure = std::current_exception();
    }
  });
  frames.join();
  if (failure) std::rethrow_exception(failure);
}

void DaemonPipeline::reload() {
  try {
    Config config = configure_();
    Sensor sensor = sensor_for(config);
    std::unique_lock lock(mutex_);
    log_sections_that_wait(config_, config);
    config.pipeline = config_.pipeline;
    config.realtime = config_.realtime;
    config.recorder = config_.recorder;
    std::optional<FrameFormat> format;
    std::shared_ptr<const Plan> plan;
    do {  // Another camera, connected meanwhile, makes another round necessary.
      format = format_;
      lock.unlock();
      if (format) plan = std::make_shared<const Plan>(sensor, *format, config);
      lock.lock();
    } while (format != format_);
    if (!format) plan.reset();
    if (plan) log_method(plan->detect.choice());
    ++configurations_;
    config_ = std::move(config);
    sensor_ = std::move(sensor);
    pending_plan_ = std::move(plan);
    spdlog::info("reload: configuration {} and sensor file are in use", config_hash(config_));
  } catch (const std::exception& error) {
    spdlog::error("reload: {}; the old plan stays", error.what());
  }
}

void DaemonPipeline::adopt_pending_plan() {
  const std::lock_guard lock(mutex_);
  if (pending_plan_ && pipeline_ && pipeline_->adopt(pending_plan_)) pending_plan_.reset();
}

bool DaemonPipeline::trigger() {
  const std::lock_guard lock(mutex_);
  if (!recorder_ || config_.recorder.mode != RecordMode::kTrigger) return false;
  recorder_->trigger();
  return true;
}

std::int64_t DaemonPipeline::finish() {
  if (recorder_) recorder_->finish();
  return writer_ ? writer_->finish() : 0;
}

}  // namespace curlew
