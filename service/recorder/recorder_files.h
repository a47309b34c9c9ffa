// RecorderFiles writes the recorder's frames into one file after the other, and leaves room on the
// disk.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "acquisition/recording/growing_recording.h"
#include "core/frame.h"
#include "core/optics.h"
#include "service/recorder/recorder.h"
#include "service/recorder/recording_compressor.h"

namespace curlew {

/// Files are named by the UTC of their first frame: FOLDER/curlew-20261123T041500.123Z.fits. No
/// file is ever overwritten. Only the constructor throws: what goes wrong later is logged once.
///
/// Recording stops before the disk has less than min_free_mb, and goes on once it has twice that
/// and memory_mb more. It stops as well where the folder is gone, and goes on once it is there
/// again. A file that was removed or moved is noticed twice a second, and a new one begun. A write
/// error stops it for good. In both cases the file can be read up to its last whole frame.
class RecorderFiles {
 public:
  /// Failure where the folder cannot be written, or the frames are not in plain ADU.
  RecorderFiles(RecorderOptions options, const FrameFormat& format, RecordingHeader header,
                std::function<void(const std::string&)> log);
  ~RecorderFiles() { end_file(); }
  RecorderFiles(const RecorderFiles&) = delete;
  RecorderFiles& operator=(const RecorderFiles&) = delete;

  /// Writes the frame into the file. Where there is none, or it is full, a new one begins.
  void write(const FrameBuffer& frame) noexcept;

  /// Lets readers see the frames so far, twice a second. Call it more often than that.
  void commit_if_due() noexcept;

  /// Says what the headers hold from now on. Where the provenance is new, a new file begins.
  void describe(const RecordingHeader& header) noexcept;

  /// Completes the file, if there is one.
  void end_file() noexcept;

  /// Any thread may call this. Its `dropped` counts the frames that write() could not record.
  RecorderCounts counts() const;

 private:
  template <typename Act>
  void or_fail(Act&& act) noexcept;
  void begin_file(const FrameHeader& first);
  bool file_is_full(const FrameHeader& next) const;
  void commit();
  void complete_file();
  bool disk_has_room();
  bool room_is_back();
  bool folder_is_there() const;
  void stop(std::int64_t resume_mb, const std::string& why);
  void notice_loss();
  void count_recorded();
  void count_the_rest_dropped();

  RecorderOptions options_;
  FrameFormat format_;
  RecordingHeader header_;
  std::function<void(const std::string&)> log_;
  std::unique_ptr<RecordingCompressor> compressor_;

  std::unique_ptr<GrowingRecording> file_;
  std::chrono::steady_clock::time_point first_received_{};
  std::chrono::steady_clock::time_point next_commit_{};
  std::chrono::steady_clock::time_point next_look_{};  ///< It looks at the full disk then.
  bool failed_ = false;                                ///< Recording has stopped for good.
  std::int64_t resume_mb_ = 0;       ///< With so much free it goes on after a stop.
  std::int64_t given_ = 0;           ///< It counts the calls of write().
  std::int64_t in_whole_files_ = 0;  ///< It counts the frames in the files before this one.

  std::atomic<std::int64_t> recorded_{0};
  std::atomic<std::int64_t> dropped_{0};
  std::atomic<std::int64_t> files_{0};
  std::atomic<bool> stopped_{false};
};

}  // namespace curlew
