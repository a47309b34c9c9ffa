// DaemonStatus knows what the daemon reports about itself: its state, its counts, its last second.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "acquisition/camera.h"
#include "core/frame_exchange.h"
#include "service/air/air_meter.h"
#include "service/daemon/beam_watch.h"
#include "service/daemon/live_statistics.h"
#include "service/metrics/live_metrics.h"
#include "service/recorder/recorder.h"
#include "service/stages.h"

namespace curlew {

/// The daemon goes searching → opening → streaming ⇄ degraded → lost → searching, from streaming
/// and degraded to no light and back, and from each of these to stopping.
enum class DaemonState {
  kSearching,  ///< There is no camera; the daemon looks for one.
  kOpening,    ///< The daemon talks to the camera.
  kStreaming,  ///< Frames come and results go out.
  kDegraded,   ///< Results go out, but in the last seconds some frames were lost or late.
  kNoLight,    ///< Frames come, but none of the last second had any light.
  kLost,       ///< The camera is gone or silent.
  kStopping,   ///< The daemon completes its files and ends.
};
const char* name_of(DaemonState state);

/// These are the counts of all connections since the daemon's start. While no camera streams,
/// frames.delivered = results + superseded + unprocessed, exactly.
struct DaemonCounts {
  FrameCounts frames;
  std::int64_t superseded = 0;   ///< It counts frames that a newer one replaced while they waited.
  std::int64_t unprocessed = 0;  ///< It counts frames that still waited when their stream ended.
  std::int64_t connections = 0;  ///< It counts how often a camera was opened.
  RecorderCounts recorder;
};

/// This is the daemon's status at one moment.
struct StatusSnapshot {
  DaemonState state = DaemonState::kSearching;
  std::string reason;  ///< It tells why the state was entered; it may be empty.
  DaemonCounts counts;
  std::int64_t results = 0;          ///< It counts the results since the start.
  bool recording = false;            ///< It says whether there is or was a recorder.
  bool recording_paused = false;     ///< The page has paused the recorder.
  StatusWindow window;               ///< It is empty where the last seconds brought no result.
  TracksSeen tracks{};               ///< since the start
  std::optional<AirReport> air{};    ///< It is that of the last window that is complete.
  std::optional<BeamReport> beam{};  ///< of the last second that had a frame
  double uptime_s = 0.0;
  std::int64_t newest_ns = 0;  ///< UTC of receipt of the last frame with a result; 0: unknown
};

/// The daemon's threads tell this object what happens, and it logs changes of the state. Any thread
/// may call its functions, except where they say which one.
class DaemonStatus {
 public:
  /// The daemon is in this state from now on.
  void enter(DaemonState state, const std::string& reason);

  /// The system refused something. Each sentence is logged once in the daemon's life.
  void refused(const std::vector<std::string>& sentences);

  void camera_opened();

  /// The camera streams into the exchange, and both are asked for their counts until
  /// stream_ended().
  void stream_began(const Camera& camera, const FrameExchange& exchange);
  /// The camera has stopped, or it failed to start. All results of its frames are out.
  void stream_ended(const Camera& camera, const FrameExchange& exchange);

  /// The recorder is asked for its counts until recorder_ended().
  void recorder_began(const Recorder& recorder);
  /// The recorder has completed its files.
  void recorder_ended(const Recorder& recorder);

  void recording_paused(bool paused) { recording_paused_ = paused; }

  /// Only the publisher's thread calls this, once a frame. It never waits, locks or allocates.
  void result_published(const FrameSlot& slot) noexcept {
    statistics_.add(slot);
    metrics_.add(slot);
    results_.fetch_add(1, std::memory_order_relaxed);
    newest_ns_.store(slot.frame->header.received_ns, std::memory_order_relaxed);
  }

  /// A window of the air is complete.
  void air_measured(const AirReport& report);

  /// Logs where the warning comes or goes.
  void beam_measured(const BeamReport& report);

  StatusSnapshot snapshot() const;
  const LiveMetrics& metrics() const { return metrics_; }

  /// Always the same thread calls this, once a second. By what the last seconds were like, the
  /// daemon goes from streaming to degraded or back. Returns the status after that.
  StatusSnapshot second_over();

 private:
  // Whoever calls these holds the mutex.
  StatusSnapshot read() const;
  void change_state(DaemonState state, const std::string& reason);
  void judge(const StatusSnapshot& now);
  /// Returns whether the state follows from how much light there was in the last second.
  bool judge_light(const StatusWindow& window);

  LiveStatistics statistics_;
  LiveMetrics metrics_;
  std::atomic<std::int64_t> results_{0};
  std::atomic<bool> recording_paused_{false};
  std::atomic<std::int64_t> newest_ns_{0};
  std::chrono::steady_clock::time_point began_ = std::chrono::steady_clock::now();

  mutable std::mutex mutex_;  // It guards everything below.
  DaemonState state_ = DaemonState::kSearching;
  std::string reason_;
  bool told_of_opening_ = false;    ///< An opening was logged since the daemon last streamed.
  const Camera* camera_ = nullptr;  ///< It is set while a camera streams.
  const FrameExchange* exchange_ = nullptr;  ///< It is set while a camera streams.
  const Recorder* recorder_ = nullptr;       ///< It is set while there is a recorder.
  std::optional<AirReport> air_;
  std::optional<BeamReport> beam_;
  DaemonCounts past_;                    ///< It leaves out the stream and the recorder that go on.
  std::int64_t past_results_ = 0;        ///< It counts the results of streams that are over.
  std::set<std::string> told_refusals_;  ///< These sentences have been logged.

  // These belong to second_over().
  StatusWindow window_;
  int quiet_seconds_ = 0;  ///< It counts the last seconds that brought no new window.
  int clean_seconds_ = 0;  ///< It counts the last seconds in which nothing was lost or late.
  std::int64_t judged_dropped_ = 0;     ///< It is the number of lost frames at its last call.
  std::int64_t judged_superseded_ = 0;  ///< It is the number of superseded frames at its last call.
};

}  // namespace curlew
