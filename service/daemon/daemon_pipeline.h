// DaemonPipeline owns all that works on the daemon's frames: the pipeline, the recorder, the JSON
// lines, and the configuration and sensor that these are made from.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "centroiding/sensor.h"
#include "service/air/air_watch.h"
#include "service/config.h"
#include "service/daemon/beam_watch.h"
#include "service/daemon/daemon_status.h"
#include "service/daemon/frame_sample.h"
#include "service/daemon/frame_snapshot.h"
#include "service/live_feed.h"
#include "service/page/live_page.h"
#include "service/pipeline.h"
#include "service/publish/stream_publisher.h"
#include "service/recorder/recorder.h"
#include "service/results/result_writer.h"
#include "service/thread_placement.h"

namespace curlew {

/// It outlives the connections to the camera, so that a camera that comes back finds everything
/// ready. The connecting thread calls prepare() and run(). The supervising thread calls reload()
/// and adopt_pending_plan(), also during these. Any thread may call config(), trigger() and
/// refused().
class DaemonPipeline {
 public:
  /// configure: reads the configuration, now and at every reload. Throws what configure throws,
  /// UsageError where no sensor file is named, and Failure where a file cannot be used.
  DaemonPipeline(std::function<Config()> configure, DaemonStatus& status,
                 const AirOptions& air = {});

  Config config() const;

  /// The page sees every frame from now on. Call it before prepare(); the page must outlive run().
  void show_on(LivePage& page) { page_ = &page; }
  /// The same for a tap.
  void show_on(FrameTap& tap) { taps_.push_back(&tap); }
  void show_on(AskedCopy<BeamSample>& tap) { beam_tap_ = &tap; }
  void show_on(AskedCopy<FrameSample>& tap) { frame_tap_ = &tap; }

  /// Makes the pipeline and the recorder for frames of this format, or keeps those of the last
  /// connection where they fit. A new pipeline gives none of the track numbers that an earlier one
  /// gave. Failure or UsageError where sensor and configuration do not fit the frames.
  void prepare(const FrameFormat& format);

  /// Takes the feed's frames through the pipeline until the feed ends. Call prepare() before it.
  void run(LiveFeed& feed);

  /// Reads configuration and sensor file again. Where something is wrong with them, that is logged
  /// and nothing changes.
  void reload();
  /// Changes one setting until the next reload. Any thread may call it. Throws UsageError or
  /// Failure where the value or what follows from it cannot be; then nothing changes.
  void change(const std::string& section, const std::string& key, const SettingValue& value);
  /// Takes up another sensor file until the next reload. Any thread may call it. Throws as
  /// change().
  void use_sensor(const std::string& path);
  /// Pauses the recorder, or lets it go on. Any thread may call it. Returns false where there is no
  /// recorder.
  bool pause_recording(bool paused);
  /// Gives the running pipeline the plan that a reload has made. Does nothing where there is none,
  /// or where the pipeline still takes up an earlier plan: call it again and again.
  void adopt_pending_plan();

  /// Returns the detector and the pitch in px of the sensor. Any thread may call it.
  std::pair<Detector, double> detector_and_pitch_px() const;

  /// Returns the sensor in use. Any thread may call it.
  Sensor sensor() const;
  /// Returns the reference beam of the sensor. Any thread may call it.
  BeamReference beam_reference() const;

  /// Triggers the recorder. Returns false where no recorder waits for a trigger.
  bool trigger();

  /// Returns the next frame with all its results, as the bytes of a results file. Failure where no
  /// frame comes in time. The supervising thread calls it.
  std::string snapshot();

  /// Returns one sentence for each CPU or priority that a thread of the pipeline was refused.
  std::vector<std::string> refused() const { return placement_.refused(); }

  /// Completes the files. Call it when no run() follows. Returns how many results are missing in
  /// the JSON lines.
  std::int64_t finish();

  /// Returns the report of all runs together. Call it only while no run() is under way.
  const RunReport& report() const { return report_; }

 private:
  void take_up(Config config);
  void tell_air(const AirReport& report);

  std::function<Config()> configure_;
  DaemonStatus& status_;
  std::atomic<bool> recording_paused_{false};
  std::mutex taking_up_;  ///< whoever takes up a configuration holds it
  const AirOptions air_options_;

  mutable std::mutex mutex_;  // It guards the members down to plan_.
  Config config_;
  Sensor sensor_;
  std::int64_t configurations_ = 0;           ///< It grows with every reload.
  bool connected_ = false;                    ///< A camera has told the format of its frames.
  std::optional<FrameFormat> format_;         ///< The pipeline and the recorder fit this format.
  std::shared_ptr<const Plan> pending_plan_;  ///< The pipeline has not adopted this plan yet.
  std::shared_ptr<const Plan> plan_;          ///< Frames that are fed now are worked on by this.

  ThreadPlacement placement_;
  // prepare() changes these under the mutex. run() uses them without it, because the same thread
  // calls both.
  std::unique_ptr<Pipeline> pipeline_;
  std::int64_t sets_made_ = 0;                   ///< The pipelines before this one made so many.
  std::unique_ptr<Recorder> recorder_;           ///< It is null where nothing is recorded.
  std::unique_ptr<StreamPublisher> streams_;     ///< It is null where nothing is published.
  std::unique_ptr<ResultWriter> writer_;         ///< It is null where no JSON lines are written.
  std::unique_ptr<AirWatch> air_;                ///< It is null where the air is not looked at.
  LivePage* page_ = nullptr;                     ///< It is null where there is no page.
  std::vector<FrameTap*> taps_;                  ///< of the terminal and of the exposure
  AskedCopy<BeamSample>* beam_tap_ = nullptr;    ///< It is null where nobody watches the beam.
  AskedCopy<FrameSample>* frame_tap_ = nullptr;  ///< It is null where none takes frames.
  SnapshotExchange snapshots_;
  RunReport report_;
};

}  // namespace curlew
