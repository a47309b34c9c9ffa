// DaemonConnection finds the camera, runs the pipeline on it, and finds it again when it is lost.
#pragma once

#include <condition_variable>
#include <memory>
#include <mutex>
#include <string>

#include "acquisition/camera.h"
#include "service/config.h"
#include "service/daemon/daemon_pipeline.h"
#include "service/daemon/daemon_status.h"
#include "service/live_feed.h"
#include "service/realtime/realtime.h"

namespace curlew {

class DaemonConnection {
 public:
  /// limits: they hold for all connections together.
  DaemonConnection(DaemonPipeline& pipeline, DaemonStatus& status, const LiveFeed::Limits& limits)
      : pipeline_(pipeline), status_(status), limits_(limits) {}

  /// Returns after stop(), at a limit, and at the end of a recording. Throws what makes it
  /// pointless to go on: a configuration that cannot be used from the start, a recording that
  /// cannot be read.
  void run();

  /// Makes run() return soon. Any thread may call it, and more than once.
  void stop();

  /// Tells run() that a camera may have arrived, so that it looks for one at once. Any thread may
  /// call it.
  void wake();

  /// Makes run() connect to the camera anew, with the settings of now. Any thread may call it.
  void reconnect();

  /// Makes a camera with a software trigger take a frame. Any thread may call it. Failure where no
  /// camera streams, or this one has no software trigger.
  void expose();

  /// As Camera has them, for the camera that streams. Any thread may call them. Failure where none
  /// streams.
  double exposure_us();
  double set_exposure_us(double exposure_us);

  /// Its `stop` tells that run() is about to return. Its `signs_of_life` grow while run() is well.
  const FeedControl& control() const { return control_; }

 private:
  bool connect(const Config& config);
  void stream(Camera& camera, const Config& config);
  LiveFeed::End run_pipeline(FrameExchange& exchange, const Config& config);
  void pause(double seconds);
  bool take_reconnect_request();
  void set_streaming(Camera* camera, FrameExchange* exchange);

  DaemonPipeline& pipeline_;
  DaemonStatus& status_;
  LiveFeed::Limits limits_;  ///< Its first_index is the index of the next frame.
  FeedControl control_;
  std::unique_ptr<ProcessRealtime> realtime_;
  std::string
      opened_;  ///< the camera that was opened last, so that it is not logged at each attempt

  std::mutex mutex_;  // It guards everything below.
  std::condition_variable woken_;
  bool wake_up_ = false;
  bool reconnecting_ = false;          ///< The stream is to end because of reconnect().
  Camera* camera_ = nullptr;           ///< It is set while a camera streams.
  FrameExchange* exchange_ = nullptr;  ///< It is set while a camera streams.
};

}  // namespace curlew
