// Recorder: frames to disk beside the pipeline, which it never slows.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <thread>

#include "core/frame.h"
#include "core/optics.h"
#include "core/side_queue.h"

namespace curlew {

enum class RecordMode {
  kOff,
  kContinuous,  ///< every frame
  kTrigger,     ///< before_s before a trigger to after_s after it
};

/// Section [recorder] of the configuration.
struct RecorderOptions {
  RecordMode mode = RecordMode::kOff;
  std::string folder = ".";
  double before_s = 5.0;           ///< kTrigger: kept in memory, as far as memory_mb reaches
  double after_s = 5.0;            ///< kTrigger
  bool trigger_on_vortex = false;  ///< kTrigger: a frame with a vortex is a trigger
  int memory_mb = 256;             ///< frames waiting to be written, or kept for a trigger
  int max_file_mb = 2000;          ///< then the next file
  double max_file_s = 600.0;       ///< then the next file
  int min_free_mb = 500;           ///< of the disk; recording stops before it has less
  bool compress = false;           ///< lossless tile compression (Rice) once a file is complete
};

/// What the recorder has done so far.
struct RecorderCounts {
  std::int64_t recorded = 0;  ///< frames on disk, where readers see them
  std::int64_t dropped = 0;   ///< frames it had no memory free for, or that the disk refused
  std::int64_t files = 0;     ///< begun
  bool stopped = false;       ///< for now: the disk is full or failing, see the log

  RecorderCounts& operator+=(const RecorderCounts& more) {
    recorded += more.recorded;
    dropped += more.dropped;
    files += more.files;
    stopped = more.stopped;
    return *this;
  }
};

/// Recordings in the folder, each named by the UTC of its first frame
/// (curlew-20261123T041500.123Z.fits; compressed, .fits.fz), each readable while it grows and after
/// a kill: see GrowingRecording. Readers see new frames twice a second.
///
/// kTrigger: an event is the frames from before_s before a trigger to after_s after it, by the
/// times they were received; a further trigger meanwhile extends it. Each event begins a file; no
/// frame is recorded twice.
///
/// Where the disk is nearly full it stops, and goes on once there is room again; after a write
/// error it stays stopped. Meanwhile frames count as dropped.
class Recorder {
 public:
  /// log: gets one sentence at a time, from threads of the recorder: files begun and complete, and
  /// why it stopped. Failure where the folder cannot be written, or the frames are not in plain
  /// ADU. Makes memory_mb of frame buffers (at least 4 frames) and begins its thread. kOff: makes
  /// nothing, and add() does nothing.
  Recorder(const RecorderOptions& options, const FrameFormat& format, const Optics& optics,
           const Detector& detector, std::function<void(const std::string&)> log);

  ~Recorder();
  Recorder(const Recorder&) = delete;
  Recorder& operator=(const Recorder&) = delete;

  /// Publisher's thread, once a frame. Copies the pixels; never waits, allocates or throws.
  void add(const FrameBuffer& frame, bool has_vortex) noexcept;

  /// Any thread, also several times; kTrigger: the next frame added is the trigger.
  void trigger() noexcept;

  /// Writes what it holds and completes the file; add() must not be called any more. What is not
  /// compressed yet stays as it is. The destructor does it too.
  RecorderCounts finish();

  /// Any thread. Frames that wait in memory are in none of the counts, and neither are those that
  /// no trigger asked for.
  RecorderCounts counts() const;

 private:
  struct Item;
  class Writer;
  std::unique_ptr<SideQueue<Item>> queue_;
  std::unique_ptr<Writer> writer_;
  bool trigger_on_vortex_;
  std::atomic<bool> triggered_{false};
  std::thread thread_;
};

}  // namespace curlew
