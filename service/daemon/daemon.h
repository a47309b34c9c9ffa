// Daemon watches a camera day and night.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "service/config.h"
#include "service/daemon/auto_exposure.h"
#include "service/daemon/beam_watch.h"
#include "service/daemon/control_socket.h"
#include "service/daemon/daemon_connection.h"
#include "service/daemon/daemon_pipeline.h"
#include "service/daemon/daemon_status.h"
#include "service/daemon/live_calibration.h"
#include "service/daemon/notify.h"
#include "service/daemon/status_printer.h"
#include "service/live_feed.h"
#include "service/metrics/metrics_server.h"
#include "service/page/live_page.h"
#include "service/page/page_server.h"
#include "service/pipeline.h"
#include "service/watch/terminal_watch.h"

namespace curlew {

/// The daemon ends after this number of results, or this time after its start.
struct DaemonLimits {
  std::int64_t frames = std::numeric_limits<std::int64_t>::max();
  double seconds = std::numeric_limits<double>::infinity();
};

/// This is all that a daemon has counted until its end.
struct DaemonReport : DaemonCounts {
  RunReport results;
  std::int64_t unwritten = 0;  ///< It counts the results that are missing in the JSON lines.
};

/// The caller's thread supervises: it looks after signals, reload, control socket and status. A
/// second thread connects to the camera. The camera, the pipeline, the recorder and the writer of
/// the JSON lines have threads of their own.
class Daemon {
 public:
  /// configure: reads the configuration, now and at every SIGHUP. air: how the air is looked at; by
  /// default it is not. watch: whether the terminal shows the frames.
  Daemon(std::function<Config()> configure, DaemonLimits limits, const AirOptions& air = {},
         bool watch = false);

  /// Returns at a limit, at SIGINT or SIGTERM, and at the end of a recording. Throws what makes it
  /// pointless to go on: a configuration or a sensor file that cannot be used from the start, a
  /// recording that does not exist.
  DaemonReport run();

 private:
  void serve_metrics();
  void serve_page();
  void supervise(const std::atomic<bool>& finished);
  void every_second();
  void follow_exposure();
  std::string answer(const std::string& word);
  DaemonFacts facts() const;

  LiveFeed::Limits limits_;
  DaemonStatus status_;
  DaemonPipeline pipeline_;
  DaemonConnection connection_;
  Supervisor supervisor_;
  std::unique_ptr<ControlSocket> control_socket_;  ///< It is null where none is configured.
  std::unique_ptr<MetricsServer> metrics_server_;  ///< It is null where none is configured.
  std::unique_ptr<LiveCalibration> calibration_;  ///< It is null where the page may change nothing.
  // These are null where no page is configured. The server is the last, because it uses the page.
  std::unique_ptr<LivePage> page_;
  std::unique_ptr<PageServer> page_server_;
  StatusPrinter printer_;
  std::unique_ptr<TerminalWatch> watch_;    ///< It is null where nobody watches on the terminal.
  std::unique_ptr<AutoExposure> exposure_;  ///< It is null where the exposure stays.
  BeamWatch beam_;
  std::vector<std::string> watched_lines_;  ///< of the last second, for the terminal
};

}  // namespace curlew
