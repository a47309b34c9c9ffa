// Recorder writes frames to disk beside the pipeline, and never slows it.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <thread>

#include "acquisition/recording/provenance.h"
#include "core/frame.h"
#include "core/optics.h"
#include "core/side_queue.h"
#include "core/vortex.h"
#include "service/program/version.h"

namespace curlew {

enum class RecordMode {
  kOff,
  kContinuous,  ///< It records every frame.
  kTrigger,     ///< It records from before_s before a trigger to after_s after it.
};

/// These are the settings of section [recorder] in the configuration.
struct RecorderOptions {
  RecordMode mode = RecordMode::kOff;
  std::string folder = ".";
  double before_s = 5.0;           ///< With kTrigger this much is kept, if memory_mb suffices.
  double after_s = 5.0;            ///< With kTrigger it records this long after a trigger.
  bool trigger_on_vortex = false;  ///< With kTrigger a frame with a vortex is a trigger.
  /// Such a vortex is at least this probable; 0: as probable as any that is reported.
  double trigger_min_probability = 0.0;
  bool trigger_tracked_only = false;  ///< Such a vortex has a track.
  int memory_mb = 256;                ///< It holds frames to be written, or kept for a trigger.
  int max_file_mb = 2000;             ///< At this size the next file begins.
  double max_file_s = 600.0;          ///< At this age the next file begins.
  int min_free_mb = 500;              ///< Recording stops before the disk has less free.
  bool compress = false;              ///< Complete files get lossless tile compression (Rice).
};

/// This is what the files' headers say beside the format of the frames.
struct RecordingHeader {
  Optics optics;
  Detector detector;
  Provenance provenance{kProgram};
};

/// This is what the recorder has done so far.
struct RecorderCounts {
  std::int64_t recorded = 0;  ///< It counts frames on disk that readers can see.
  std::int64_t dropped = 0;   ///< It counts frames that memory or disk did not take.
  std::int64_t files = 0;     ///< It counts files that were begun.
  bool stopped = false;       ///< The disk is full or failing at present; the log tells more.

  RecorderCounts& operator+=(const RecorderCounts& more) {
    recorded += more.recorded;
    dropped += more.dropped;
    files += more.files;
    stopped = more.stopped;
    return *this;
  }
};

/// It writes recordings into the folder. Each is named by the UTC of its first frame:
/// curlew-20261123T041500.123Z.fits, or .fits.fz once it is compressed. Each can be read while it
/// grows and after a kill, as GrowingRecording explains. Readers see new frames twice a second.
///
/// With kTrigger an event holds the frames that were received from before_s before a trigger to
/// after_s after it. A further trigger in this time extends the event. Each event begins a file,
/// and no frame is recorded twice.
///
/// Where the disk is nearly full, or the folder gone, it stops, and goes on once there is room
/// again. After a write error it stays stopped. While it is stopped, frames count as dropped. Where
/// somebody removes or moves the file, a new one begins within a second. Frames in a file that was
/// removed are lost, and count as dropped.
class Recorder {
 public:
  /// Makes memory_mb of frame buffers (at least 4 frames) and begins its thread. With kOff it makes
  /// nothing, and add() does nothing. log: threads of the recorder call it with one sentence at a
  /// time, when a file is begun or complete, and when recording stops or goes on. Failure where the
  /// folder cannot be written, or the frames are not in plain ADU. UsageError where memory_mb is
  /// more than half of the machine's memory.
  Recorder(const RecorderOptions& options, const FrameFormat& format, const RecordingHeader& header,
           std::function<void(const std::string&)> log);

  ~Recorder();
  Recorder(const Recorder&) = delete;
  Recorder& operator=(const Recorder&) = delete;

  /// The publisher's thread calls this once a frame. It copies the pixels, and never waits,
  /// allocates or throws. vortices: those of the frame, which may be triggers; null: none.
  void add(const FrameBuffer& frame, const VortexList* vortices = nullptr) noexcept;

  /// Says what the headers hold from now on. Where the provenance is new, so is the file. Any
  /// thread may call this.
  void describe(const RecordingHeader& header);

  /// With kTrigger the next frame added is the trigger. Any thread may call this, and more than
  /// once.
  void trigger() noexcept;

  /// Writes the frames it holds and completes the file. add() must not be called after that. Files
  /// that are not compressed yet stay as they are. The destructor calls this too.
  RecorderCounts finish();

  /// Any thread may call this. Frames that wait in memory are in none of the counts, and neither
  /// are those that no trigger asked for.
  RecorderCounts counts() const;

 private:
  struct Item;
  class Writer;
  const Vortex* triggering(const VortexList& vortices) const noexcept;

  RecorderOptions options_;
  std::unique_ptr<SideQueue<Item>> queue_;
  std::unique_ptr<Writer> writer_;
  std::atomic<bool> triggered_{false};
  std::thread thread_;
};

}  // namespace curlew
