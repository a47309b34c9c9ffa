#include "service/daemon/daemon.h"

#include <spdlog/spdlog.h>

#include <chrono>
#include <exception>
#include <filesystem>
#include <thread>
#include <utility>

#include "acquisition/open_camera.h"
#include "acquisition/usb/usb_watcher.h"
#include "core/error.h"
#include "service/daemon/page_changes.h"
#include "service/metrics/metrics_text.h"
#include "service/program/interrupt.h"

namespace curlew {
namespace {

using Clock = std::chrono::steady_clock;

constexpr int kTickMs = 100;
// A connecting thread that gives no sign of life for longer than this hangs.
constexpr auto kLongestSilence = std::chrono::seconds(20);

LiveFeed::Limits feed_limits(const DaemonLimits& limits) {
  LiveFeed::Limits feed;
  feed.end_index = limits.frames;
  if (limits.seconds < 1e9)
    feed.until = Clock::now() + std::chrono::duration_cast<Clock::duration>(
                                    std::chrono::duration<double>(limits.seconds));
  return feed;
}

}  // namespace

Daemon::Daemon(std::function<Config()> configure, DaemonLimits limits, const AirOptions& air,
               bool watch)
    : limits_(feed_limits(limits)),
      pipeline_(std::move(configure), status_, air),
      connection_(pipeline_, status_, limits_) {
  const std::string control = pipeline_.config().daemon.control;
  if (!control.empty()) control_socket_ = std::make_unique<ControlSocket>(control);
  serve_metrics();
  serve_page();
  pipeline_.show_on(beam_.tap());
  if (pipeline_.config().camera.auto_exposure) {
    exposure_ = std::make_unique<AutoExposure>(pipeline_.config().camera);
    pipeline_.show_on(exposure_->tap());
  }
  if (!watch) return;
  watch_ = std::make_unique<TerminalWatch>();
  pipeline_.show_on(watch_->tap());
}

void Daemon::serve_metrics() {
  const MetricsOptions metrics = pipeline_.config().metrics;
  if (metrics.listen.empty()) return;
  metrics_server_ = std::make_unique<MetricsServer>(
      metrics, [this] { return metrics_text(status_.metrics(), status_.snapshot()); });
  spdlog::info("metrics: answered at port {}", metrics_server_->port());
}

void Daemon::serve_page() {
  const Config config = pipeline_.config();
  if (config.page.listen.empty()) return;
  std::vector<std::string> settings;
  if (config.page.control) settings.assign(kPageSettings.begin(), kPageSettings.end());
  page_ = std::make_unique<LivePage>([this] { return status_json(status_.snapshot(), facts()); },
                                     config.camera.source, settings);
  pipeline_.show_on(*page_);
  PageControl control;
  if (config.page.control) {
    calibration_ = std::make_unique<LiveCalibration>(pipeline_);
    control = [this](const std::string& body, const std::string& peer) {
      return change_by_page({pipeline_, connection_, *calibration_}, body, peer);
    };
  }
  page_server_ = std::make_unique<PageServer>(config.page, *page_, std::move(control));
  spdlog::info("page: {}", page_server_->url());
}

DaemonReport Daemon::run() {
  const CameraOptions camera = pipeline_.config().camera;
  spdlog::info("state={} {}", name_of(DaemonState::kSearching), camera.source);
  std::unique_ptr<UsbWatcher> usb;
  try {
    if (comes_and_goes(camera))
      usb = std::make_unique<UsbWatcher>([this](UsbChange change) {
        if (change == UsbChange::kArrived) connection_.wake();
      });
  } catch (const Failure& failure) {
    // The daemon goes on, because a network camera needs no watcher.
    spdlog::warn("{}; arrivals are noticed later", failure.what());
  }
  std::exception_ptr connecting_failure;
  std::atomic<bool> finished{false};
  std::thread connecting([&] {
    try {
      connection_.run();
    } catch (...) {
      connecting_failure = std::current_exception();
    }
    finished = true;
  });
  std::exception_ptr supervising_failure;
  try {
    supervisor_.ready("searching");
    supervise(finished);
  } catch (...) {
    supervising_failure = std::current_exception();
    connection_.stop();
  }
  connecting.join();
  watch_.reset();
  if (calibration_) calibration_->stop();
  const std::int64_t unwritten = pipeline_.finish();
  if (connecting_failure) std::rethrow_exception(connecting_failure);
  if (supervising_failure) std::rethrow_exception(supervising_failure);
  return {status_.snapshot().counts, pipeline_.report(), unwritten};
}

/// Looks after everything but the camera until the connecting thread has finished.
void Daemon::supervise(const std::atomic<bool>& finished) {
  auto next_second = Clock::now() + std::chrono::seconds(1);
  auto last_sign = Clock::now();
  std::int64_t seen_signs = -1;
  bool stopping = false;
  do {
    if (control_socket_)
      control_socket_->serve(kTickMs, [this](const std::string& word) { return answer(word); });
    else
      std::this_thread::sleep_for(std::chrono::milliseconds(kTickMs));
    if (interrupted() || Clock::now() > limits_.until) connection_.stop();
    if (!stopping && connection_.control().stop) {
      stopping = true;
      supervisor_.stopping();
    }
    if (take_reload_request()) {
      supervisor_.reloading();
      pipeline_.reload();
      supervisor_.ready("reloaded");
    }
    if (take_trigger_request()) spdlog::info("recorder: {}", answer("trigger"));
    pipeline_.adopt_pending_plan();
    const std::int64_t signs = connection_.control().signs_of_life;
    if (std::exchange(seen_signs, signs) != signs) last_sign = Clock::now();
    if (Clock::now() - last_sign < kLongestSilence) supervisor_.watchdog();
    if (watch_) watch_->draw(watched_lines_);
    follow_exposure();
    beam_.look();
    if (Clock::now() >= next_second) {
      every_second();
      next_second += std::chrono::seconds(1);
    }
  } while (!finished);
}

/// Adapts the camera's exposure to the light, where that is configured.
void Daemon::follow_exposure() {
  if (!exposure_ || connection_.control().stop) return;
  const StatusSnapshot status = status_.snapshot();
  const auto [detector, pitch_px] = pipeline_.detector_and_pitch_px();
  const std::string said = exposure_->step(
      {[this] { return connection_.exposure_us(); },
       [this](double exposure_us) { return connection_.set_exposure_us(exposure_us); }},
      detector, pitch_px, status.recording && !status.recording_paused);
  if (!said.empty()) spdlog::info("{}", said);
}

void Daemon::every_second() {
  status_.refused(pipeline_.refused());
  if (const auto beam = beam_.second_over(pipeline_.beam_reference())) status_.beam_measured(*beam);
  const StatusSnapshot status = status_.second_over();
  if (!watch_) printer_.add(status);
  supervisor_.status(status_line(status));
  watched_lines_ = {status_line(status)};
  if (status.beam) watched_lines_.push_back(beam_line(*status.beam));
}

DaemonFacts Daemon::facts() const {
  const Config config = pipeline_.config();
  DaemonFacts facts{config_hash(config), config.camera.source, {}, {}};
  std::error_code unknown;
  const auto space = std::filesystem::space(config.recorder.folder, unknown);
  if (!unknown && config.recorder.mode != RecordMode::kOff)
    facts.free_mb = static_cast<std::int64_t>(space.available / 1'000'000);
  if (calibration_) facts.calibration = calibration_->text();
  return facts;
}

/// Answers the words of `curlew control`.
std::string Daemon::answer(const std::string& word) {
  if (word == "status") return status_json(status_.snapshot(), facts());
  if (word == "metrics") return metrics_text(status_.metrics(), status_.snapshot());
  if (word == "trigger")
    return pipeline_.trigger()
               ? "triggered"
               : "error: set mode = \"trigger\" in section [recorder] to record on a trigger";
  if (word == "expose" || word == "snapshot") {
    try {
      if (word == "snapshot") return pipeline_.snapshot();
      connection_.expose();
      return "exposed";
    } catch (const std::exception& error) {
      return std::string("error: ") + error.what();
    }
  }
  return "error: status, metrics, snapshot, trigger and expose are known, not '" + word + "'";
}

}  // namespace curlew
