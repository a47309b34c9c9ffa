#include "service/daemon/daemon_pipeline.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <chrono>
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
  if (!config.daemon.sensor.empty()) {
    try {
      return read_sensor(config.daemon.sensor);
    } catch (const Failure& failure) {
      // It would be so again. As a matter of configuration it is no reason to start anew.
      throw UsageError(failure.what());
    }
  }
  if (is_simulated(config)) return simulated_sensor(config.centroid);
  throw UsageError(
      "no sensor file: give --sensor, or sensor in section [daemon] of the configuration; "
      "'curlew calibrate' makes one");
}

/// Returns the configuration with what its streams need.
Config completed(Config config) {
  const auto& streams = config.publish.streams;
  config.split.hidden_phase |=
      std::count(streams.begin(), streams.end(), PublishedStream::kWholePhase) > 0;
  return config;
}

/// Throws Failure if the new sensor has other lenslets than the streams that are published.
void check_streams(const Config& config, const LensletGrid& old, const LensletGrid& fresh) {
  if (config.publish.streams.empty() || (old.rows == fresh.rows && old.cols == fresh.cols)) return;
  throw Failure(
      fmt::format("the published streams are of {} x {} lenslets, and the sensor file has {} x {}; "
                  "start curlew again for it",
                  old.cols, old.rows, fresh.cols, fresh.rows));
}

void log_method(const MethodChoice& choice) {
  if (const std::string line = method_line(choice); !line.empty()) spdlog::info("{}", line);
}

void log_recorder(const std::string& sentence) {
  const bool bad = sentence.rfind("recording stopped", 0) == 0;
  spdlog::log(bad ? spdlog::level::warn : spdlog::level::info, "{}", sentence);
}

RecordingHeader header_for(const Config& config, const Sensor& sensor) {
  RecordingHeader header{sensor.optics, sensor.detector, provenance_of(config)};
  header.provenance.sensor_hash = sensor_hash(sensor);
  return header;
}

/// Refuses a trigger that would wait for ever.
void check_trigger(const Config& config, const Sensor& sensor) {
  const RecorderOptions& recorder = config.recorder;
  if (recorder.mode != RecordMode::kTrigger || !recorder.trigger_on_vortex) return;
  if (recorder.trigger_tracked_only && !config.track.enabled)
    throw UsageError(
        "[recorder] trigger_tracked_only needs tracks: set enabled in section [track]");
  if (recorder.trigger_min_probability > 0.0 && !config.track.enabled &&
      choose_method(sensor, config).method == DetectMethod::kCirculation)
    throw UsageError(
        "[recorder] trigger_min_probability needs probabilities, and the method circulation knows "
        "none: take another method in [detect], or set enabled in section [track]");
}

/// Refuses a sensor file for other frames than those of the one in use. Before the first connection
/// nothing else is known of the frames that will come.
void check_same_frames(const Sensor& used, const Sensor& fresh) {
  const auto frames_of = [](const Sensor& sensor) {
    return fmt::format("{} x {} px, binned {}, from ({}, {})", sensor.frame_cols, sensor.frame_rows,
                       sensor.binning, sensor.offset_x_px, sensor.offset_y_px);
  };
  if (frames_of(used) == frames_of(fresh)) return;
  throw UsageError("the sensor file is for frames of " + frames_of(fresh) +
                   ", and the one in use for " + frames_of(used) +
                   "; start curlew again for other frames");
}

/// Logs which of the changed sections have to wait, and for what. The sensor file need not wait,
/// although it stands in section [daemon].
void log_sections_that_wait(const Config& old, Config fresh) {
  fresh.daemon.sensor = old.daemon.sensor;
  for (const std::string& section : changed_sections(old, fresh))
    if (section == "pipeline" || section == "realtime" || section == "recorder" ||
        section == "publish" || section == "metrics" || section == "page" || section == "daemon")
      spdlog::warn("reload: [{}] takes effect when curlew is started again", section);
    else if (section == "camera" || section == "usb")
      spdlog::info("reload: [{}] takes effect when the camera is connected again", section);
}

}  // namespace

DaemonPipeline::DaemonPipeline(std::function<Config()> configure, DaemonStatus& status,
                               const AirOptions& air)
    : configure_(std::move(configure)),
      status_(status),
      air_options_(air),
      config_(completed(configure_())),
      sensor_(sensor_for(config_)),
      placement_(config_.pipeline.cpus, config_.realtime.priority) {
  check_trigger(config_, sensor_);
  const DaemonOptions& daemon = config_.daemon;
  if (daemon.jsonl.empty()) return;
  try {
    writer_ =
        std::make_unique<ResultWriter>(daemon.jsonl, daemon.lines, config_.pipeline.max_vortices);
  } catch (const Failure& failure) {
    throw UsageError(failure.what());  // as with the sensor file
  }
}

Config DaemonPipeline::config() const {
  const std::lock_guard lock(mutex_);
  return config_;
}

// What takes long is done without the mutex, so that the supervising thread never waits for it.
void DaemonPipeline::prepare(const FrameFormat& format) {
  std::unique_lock lock(mutex_);
  connected_ = true;
  if (format_ == format) return;
  format_.reset();  // Until everything fits the new format a reload makes no plan.
  if (pipeline_) sets_made_ = pipeline_->sets_made();
  pipeline_.reset();
  streams_.reset();
  air_.reset();
  pending_plan_.reset();
  plan_.reset();
  const std::unique_ptr<Recorder> old = std::move(recorder_);
  lock.unlock();
  if (old) {
    old->finish();
    status_.recorder_ended(*old);
  }
  lock.lock();
  std::int64_t made_from = -1;
  MethodChoice choice;
  std::shared_ptr<const Plan> plan;
  std::unique_ptr<Pipeline> pipeline;
  std::unique_ptr<StreamPublisher> streams;
  std::unique_ptr<AirWatch> air;
  std::unique_ptr<Recorder> recorder;
  while (made_from != configurations_) {  // A reload meanwhile makes another round necessary.
    made_from = configurations_;
    const Config config = config_;
    const Sensor sensor = sensor_;
    lock.unlock();
    plan = std::make_shared<const Plan>(sensor, format, config);
    choice = plan->detect.choice();
    pipeline =
        std::make_unique<Pipeline>(plan, config.pipeline, placement_.thread_start(), sets_made_);
    streams.reset();
    if (!config.publish.streams.empty())
      streams = std::make_unique<StreamPublisher>(config.publish, *plan, format);
    air.reset();
    if (air_options_.window_s > 0.0)
      air = std::make_unique<AirWatch>(*plan, air_options_,
                                       [this](const AirReport& report) { tell_air(report); });
    recorder.reset();
    if (config.recorder.mode != RecordMode::kOff)
      recorder = std::make_unique<Recorder>(config.recorder, format, header_for(config, sensor),
                                            log_recorder);
    lock.lock();
  }
  if (page_ != nullptr) page_->know(plan);
  if (writer_ && config_.daemon.lines.zernike)
    writer_->show_modes(std::make_unique<FrameModes>(*plan));
  plan_ = std::move(plan);
  pipeline_ = std::move(pipeline);
  streams_ = std::move(streams);
  air_ = std::move(air);
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
    if (streams_) streams_->publish(slot);
    if (recorder_ && !recording_paused_) recorder_->add(*slot.frame, &slot.vortices);
    snapshots_.offer(slot);
  };
  publisher.finish = [&, dropped_before = report_.dropped](const FrameSlot& slot,
                                                           std::int64_t dropped) {
    if (writer_) writer_->add(slot, dropped_before + dropped);
    if (page_ != nullptr) page_->pass(slot, dropped_before + dropped);
    for (FrameTap* tap : taps_) tap->pass(slot, dropped_before + dropped);
    if (beam_tap_ != nullptr) beam_tap_->offer(slot);
    if (frame_tap_ != nullptr) frame_tap_->offer(slot);
    if (air_) air_->add(slot);
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
    const std::lock_guard one_at_a_time(taking_up_);
    take_up(completed(configure_()));
    spdlog::info("reload: configuration {} and sensor file are in use", config_hash(config()));
  } catch (const std::exception& error) {
    spdlog::error("reload: {}; the old plan stays", error.what());
  }
}

void DaemonPipeline::change(const std::string& section, const std::string& key,
                            const SettingValue& value) {
  const std::lock_guard one_at_a_time(taking_up_);
  Config changed = with_setting(config(), section, key, value);
  refuse_settings_without_effect(changed);
  take_up(std::move(changed));
}

void DaemonPipeline::use_sensor(const std::string& path) {
  const std::lock_guard one_at_a_time(taking_up_);
  Config changed = config();
  changed.daemon.sensor = path;
  take_up(std::move(changed));
}

/// Makes the plan of a configuration, for the pipeline to adopt. Throws where it cannot be made;
/// then nothing has changed. Whoever calls it holds taking_up_.
void DaemonPipeline::take_up(Config config) {
  Sensor sensor = sensor_for(config);
  std::unique_lock lock(mutex_);
  check_streams(config_, sensor_.grid, sensor.grid);
  log_sections_that_wait(config_, config);
  config.pipeline = config_.pipeline;
  config.realtime = config_.realtime;
  config.recorder = config_.recorder;
  config.publish = config_.publish;
  config.metrics = config_.metrics;
  config.page = config_.page;
  if (air_options_.window_s > 0.0 && sensor_hash(sensor) != sensor_hash(sensor_))
    spdlog::warn("reload: the air is of the old sensor; start curlew again for the new one's");
  check_trigger(config, sensor);
  if (!connected_) check_same_frames(sensor_, sensor);
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
  if (plan && page_ != nullptr) page_->know(plan);
  ++configurations_;
  config_ = std::move(config);
  sensor_ = std::move(sensor);
  pending_plan_ = std::move(plan);
  if (recorder_) recorder_->describe(header_for(config_, sensor_));
}

void DaemonPipeline::tell_air(const AirReport& report) {
  status_.air_measured(report);
  if (writer_) writer_->tell_air(report);
}

void DaemonPipeline::adopt_pending_plan() {
  const std::lock_guard lock(mutex_);
  if (pending_plan_ && pipeline_ && pipeline_->adopt(pending_plan_))
    plan_ = std::exchange(pending_plan_, nullptr);
}

std::pair<Detector, double> DaemonPipeline::detector_and_pitch_px() const {
  const std::lock_guard lock(mutex_);
  return {sensor_.detector, sensor_.grid.pitch_px()};
}

Sensor DaemonPipeline::sensor() const {
  const std::lock_guard lock(mutex_);
  return sensor_;
}

BeamReference DaemonPipeline::beam_reference() const {
  const std::lock_guard lock(mutex_);
  return {measure_beam(sensor_.flux_adu, sensor_.valid), sensor_.optics.pitch_m};
}

bool DaemonPipeline::trigger() {
  const std::lock_guard lock(mutex_);
  if (!recorder_ || config_.recorder.mode != RecordMode::kTrigger) return false;
  recorder_->trigger();
  return true;
}

bool DaemonPipeline::pause_recording(bool paused) {
  const std::lock_guard lock(mutex_);
  if (!recorder_) return false;
  recording_paused_ = paused;
  status_.recording_paused(paused);
  return true;
}

std::string DaemonPipeline::snapshot() {
  constexpr std::chrono::milliseconds kPatience{3000};
  std::unique_lock lock(mutex_);
  const std::shared_ptr<const Plan> plan = plan_;
  const std::optional<FrameFormat> format = format_;
  lock.unlock();
  if (!plan || !format) throw Failure("there is no camera yet, so there is no frame to take");
  FrameSnapshot snapshot(plan, *format);
  if (!snapshots_.wait(snapshot, kPatience)) throw Failure("no frame came within 3 s");
  return snapshot.file();
}

std::int64_t DaemonPipeline::finish() {
  air_.reset();
  if (recorder_) recorder_->finish();
  return writer_ ? writer_->finish() : 0;
}

}  // namespace curlew
