// Daemon: a camera watched day and night.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <exception>
#include <functional>
#include <limits>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "acquisition/camera.h"
#include "centroiding/sensor.h"
#include "service/config.h"
#include "service/daemon/control_socket.h"
#include "service/daemon/live_statistics.h"
#include "service/daemon/notify.h"
#include "service/daemon/status_printer.h"
#include "service/live_feed.h"
#include "service/pipeline.h"
#include "service/realtime/realtime.h"
#include "service/recorder/recorder.h"
#include "service/results/result_writer.h"
#include "service/thread_placement.h"

namespace curlew {

/// searching → opening → streaming ⇄ degraded → lost → searching; from each of them → stopping.
enum class DaemonState {
  kSearching,  ///< no camera; looks for one after a pause, or when something is plugged in
  kOpening,    ///< talks to the camera
  kStreaming,  ///< frames come and results go out
  kDegraded,   ///< they do, but in the last seconds some were lost or late
  kLost,       ///< the camera is gone or silent
  kStopping,   ///< files are completed
};
const char* name_of(DaemonState state);

struct DaemonLimits {
  std::int64_t frames = std::numeric_limits<std::int64_t>::max();  ///< results, then it ends
  double seconds = std::numeric_limits<double>::infinity();  ///< after its start, then it ends
};

/// All that a daemon has counted. delivered = results + superseded + unprocessed, exactly.
struct DaemonReport {
  RunReport results;
  FrameCounts frames;            ///< of all cameras' sessions together
  std::int64_t superseded = 0;   ///< delivered, but a newer one came before the pipeline was free
  std::int64_t unprocessed = 0;  ///< delivered, but the stream ended before their turn
  std::int64_t connections = 0;  ///< times a camera was opened
  std::int64_t unwritten = 0;    ///< results missing in the JSON lines
  RecorderCounts recorder;
};

/// Finds the camera, runs the pipeline on it, finds it again when it is lost. Threads: the caller's
/// supervises (signals, reload, status); one connects; the pipeline's, the camera's, the
/// recorder's and the writer's own.
class Daemon {
 public:
  /// configure: reads the configuration; called again at SIGHUP.
  Daemon(std::function<Config()> configure, DaemonLimits limits);
  ~Daemon();
  Daemon(const Daemon&) = delete;
  Daemon& operator=(const Daemon&) = delete;

  /// Until a limit, SIGINT or SIGTERM. Throws what makes it pointless to go on: a configuration or
  /// a sensor file that cannot be used from the start, a recording that does not exist.
  DaemonReport run();

 private:
  // The connecting thread: daemon_connection.cpp.
  void connect_until_stopped();
  bool connect(const Config& config);
  void stream(Camera& camera, const Config& config);
  void prepare(const FrameFormat& format);
  LiveFeed::End run_pipeline(FrameExchange& exchange, const Config& config);
  void pause(double seconds);

  // The supervising thread: daemon.cpp.
  void supervise();
  void reload();
  void adopt_pending_plan();
  void every_second();
  void judge(const FrameCounts& counts, std::int64_t superseded, const StatusWindow& window);
  std::string answer(const std::string& word);

  // Either.
  void tell_refusals(const std::vector<std::string>& sentences);
  /// only_from: nothing happens in another state.
  void set_state(DaemonState state, const std::string& reason,
                 std::optional<DaemonState> only_from = {});
  void request_stop();
  void wake();
  Config current_config() const;
  DaemonReport report_so_far() const;

  std::function<Config()> configure_;
  DaemonLimits limits_;
  std::chrono::steady_clock::time_point started_;
  FeedControl control_;
  std::atomic<std::int64_t> results_{0};  ///< so far, for the status

  mutable std::mutex mutex_;  ///< guards all below; never taken on the frame path
  std::condition_variable woken_;
  bool wake_up_ = false;
  Config config_;
  Sensor sensor_;
  std::int64_t configurations_ = 0;  ///< grows with every reload
  DaemonState state_ = DaemonState::kSearching;
  bool told_of_opening_ = false;  ///< since it last streamed: attempts are not told one by one
  std::string state_reason_;
  Camera* camera_ = nullptr;           ///< while one streams
  FrameExchange* exchange_ = nullptr;  ///< while one streams
  std::optional<FrameFormat> format_;  ///< of the camera seen last
  std::shared_ptr<Pipeline> pipeline_;
  std::shared_ptr<const Plan> pending_plan_;  ///< to be adopted when the last one is taken up
  std::unique_ptr<Recorder> recorder_;
  DaemonReport totals_;  ///< of the sessions that are over
  bool finished_ = false;
  std::exception_ptr fatal_;

  // Made before streaming begins, used by the publisher's thread.
  std::unique_ptr<ResultWriter> writer_;
  LiveStatistics statistics_;
  ThreadPlacement placement_;
  std::unique_ptr<ProcessRealtime> realtime_;
  std::int64_t next_index_ = 0;

  std::mutex refusals_mutex_;
  std::set<std::string> told_refusals_;

  // The supervising thread's.
  Supervisor supervisor_;
  std::unique_ptr<ControlSocket> control_socket_;
  StatusPrinter printer_;
  FrameCounts judged_counts_;
  std::int64_t judged_superseded_ = 0;
  int clean_seconds_ = 0;
  StatusWindow last_window_;
  int quiet_seconds_ = 0;
};

}  // namespace curlew
