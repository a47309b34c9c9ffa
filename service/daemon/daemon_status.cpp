#include "service/daemon/daemon_status.h"

#include <spdlog/spdlog.h>

namespace curlew {
namespace {

constexpr int kCleanSecondsToRecover = 3;
constexpr int kQuietSeconds = 3;  // The status keeps the last results for less than this.

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
    case DaemonState::kNoLight:
      return "no light";
    case DaemonState::kLost:
      return "lost";
    case DaemonState::kStopping:
      return "stopping";
  }
  return "";
}

void DaemonStatus::enter(DaemonState state, const std::string& reason) {
  const std::lock_guard lock(mutex_);
  change_state(state, reason);
}

void DaemonStatus::refused(const std::vector<std::string>& sentences) {
  const std::lock_guard lock(mutex_);
  for (const std::string& sentence : sentences)
    if (told_refusals_.insert(sentence).second) spdlog::warn("{}", sentence);
}

void DaemonStatus::camera_opened() {
  const std::lock_guard lock(mutex_);
  ++past_.connections;
}

void DaemonStatus::stream_began(const Camera& camera, const FrameExchange& exchange) {
  const std::lock_guard lock(mutex_);
  camera_ = &camera;
  exchange_ = &exchange;
}

void DaemonStatus::stream_ended(const Camera& camera, const FrameExchange& exchange) {
  const std::lock_guard lock(mutex_);
  camera_ = nullptr;
  exchange_ = nullptr;
  past_.frames += camera.counts();
  past_.superseded += exchange.superseded();
  past_.unprocessed += exchange.delivered() - exchange.superseded() - (results_ - past_results_);
  past_results_ = results_;
}

void DaemonStatus::recorder_began(const Recorder& recorder) {
  const std::lock_guard lock(mutex_);
  recorder_ = &recorder;
}

void DaemonStatus::recorder_ended(const Recorder& recorder) {
  const std::lock_guard lock(mutex_);
  recorder_ = nullptr;
  past_.recorder += recorder.counts();
}

void DaemonStatus::air_measured(const AirReport& report) {
  const std::lock_guard lock(mutex_);
  air_ = report;
}

void DaemonStatus::beam_measured(const BeamReport& report) {
  const std::lock_guard lock(mutex_);
  const std::string before = beam_ ? beam_->warning : "";
  beam_ = report;
  if (report.warning == before) return;
  if (report.warning.empty())
    spdlog::info("the beam is on the lenslets again");
  else
    spdlog::warn("{}", report.warning);
}

StatusSnapshot DaemonStatus::snapshot() const {
  const std::lock_guard lock(mutex_);
  return read();
}

StatusSnapshot DaemonStatus::second_over() {
  const std::lock_guard lock(mutex_);
  // A window ends with a frame, so a second may pass without a new one; the last one stays then.
  if (statistics_.take(window_))
    quiet_seconds_ = 0;
  else if (++quiet_seconds_ >= kQuietSeconds)
    window_ = {};
  StatusSnapshot now = read();
  judge(now);
  now.state = state_;
  now.reason = reason_;
  return now;
}

StatusSnapshot DaemonStatus::read() const {
  StatusSnapshot now{.state = state_, .reason = reason_, .counts = past_, .window = window_};
  if (camera_ != nullptr) now.counts.frames += camera_->counts();
  if (exchange_ != nullptr) now.counts.superseded += exchange_->superseded();
  if (recorder_ != nullptr) now.counts.recorder += recorder_->counts();
  now.results = results_;
  now.recording_paused = recording_paused_;
  now.tracks = metrics_.tracks.seen();
  now.air = air_;
  if (window_.frames > 0) now.beam = beam_;
  now.newest_ns = newest_ns_;
  now.uptime_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - began_).count();
  const RecorderCounts& recorder = now.counts.recorder;
  now.recording = recorder_ != nullptr || recorder.files > 0 || recorder.dropped > 0;
  return now;
}

void DaemonStatus::change_state(DaemonState state, const std::string& reason) {
  if (state == state_ && reason == reason_) return;
  // While no camera is there the daemon tries to open one again and again. Only the first attempt
  // is worth a line in the log.
  const bool again =
      told_of_opening_ && (state == DaemonState::kOpening ||
                           (state == DaemonState::kSearching && state_ == DaemonState::kOpening));
  if (state == DaemonState::kOpening) told_of_opening_ = true;
  if (state == DaemonState::kStreaming) told_of_opening_ = false;
  state_ = state;
  reason_ = reason;
  spdlog::log(again ? spdlog::level::debug : spdlog::level::info, "state={}{}{}", name_of(state),
              reason.empty() ? "" : " ", reason);
}

void DaemonStatus::judge(const StatusSnapshot& now) {
  const std::int64_t dropped = now.counts.frames.dropped() - judged_dropped_;
  const std::int64_t superseded = now.counts.superseded - judged_superseded_;
  judged_dropped_ += dropped;
  judged_superseded_ += superseded;
  const bool clean = dropped == 0 && superseded == 0 && now.window.late == 0;
  clean_seconds_ = clean ? clean_seconds_ + 1 : 0;
  if (judge_light(now.window)) return;
  if (!clean && state_ == DaemonState::kStreaming)
    change_state(DaemonState::kDegraded,
                 fmt::format("{} frames lost or damaged, {} superseded, {} late in a second",
                             dropped, superseded, now.window.late));
  else if (clean_seconds_ >= kCleanSecondsToRecover && state_ == DaemonState::kDegraded &&
           (now.window.frames == 0 || now.window.measured > 0))
    change_state(DaemonState::kStreaming, "");
}

bool DaemonStatus::judge_light(const StatusWindow& window) {
  if (window.frames == 0) return false;
  const bool results_go_out = state_ == DaemonState::kStreaming ||
                              state_ == DaemonState::kDegraded || state_ == DaemonState::kNoLight;
  if (!results_go_out) return false;
  if (window.dark == window.frames) {
    change_state(DaemonState::kNoLight, "nothing is measured, because no lenslet has light");
    return true;
  }
  if (window.measured == 0) {
    change_state(DaemonState::kDegraded,
                 "nothing is measured, because no lenslet has a spot that counts");
    return true;
  }
  if (state_ == DaemonState::kNoLight) change_state(DaemonState::kStreaming, "");
  return false;
}

}  // namespace curlew
