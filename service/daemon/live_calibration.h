// LiveCalibration takes darks and references from the running camera, and gives the pipeline the
// sensor that follows from them.
#pragma once

#include <atomic>
#include <cstdint>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "core/frame.h"
#include "service/daemon/daemon_pipeline.h"
#include "service/page/asked_copy.h"

namespace curlew {

/// Works in a thread of its own beside the frames, of which it copies one at a time; all of them go
/// on through the pipeline. Files get new names with the time in the folder of section [recorder],
/// and no file is ever replaced.
class LiveCalibration {
 public:
  explicit LiveCalibration(DaemonPipeline& pipeline);
  ~LiveCalibration() { stop(); }
  LiveCalibration(const LiveCalibration&) = delete;
  LiveCalibration& operator=(const LiveCalibration&) = delete;

  enum class Kind {
    kDark,       ///< A stack of darks, for the next reference.
    kReference,  ///< Frames of the reference beam. Optics, detector, flat and bad pixels stay those
                 ///< of the sensor in use; the dark is the last one taken, else the sensor's.
  };
  /// Begins, and returns at once. asked_by: who is named in the log at the end. Throws UsageError
  /// while something is being taken, for less than 1 or more than 10000 frames, and when stopped.
  void begin(Kind kind, std::int64_t frames, const std::string& asked_by);

  /// Returns a sentence on what is being done or on how it ended; empty before the first begin().
  std::string text() const;

  /// Gives up what is being taken; the old sensor stays. Nothing can begin afterwards.
  void stop();

 private:
  struct Task {
    Kind kind;
    std::int64_t frames;
    std::string asked_by;
  };
  void work(const Task& task);
  std::string take(const Task& task, const std::string& path);
  std::string use_dark(const std::string& taken);
  std::string use_reference(const std::string& taken);
  void say(const std::string& text);

  DaemonPipeline& pipeline_;
  AskedCopy<FrameSample> tap_;
  std::string dark_;  ///< the last one; only the working thread touches it
  std::atomic<bool> stopping_{false};
  std::atomic<bool> working_{false};

  mutable std::mutex mutex_;  // It guards everything below.
  std::string text_;
  std::thread thread_;
};

}  // namespace curlew
