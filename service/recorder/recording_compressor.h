// RecordingCompressor: compresses complete recordings while nothing else needs the processor.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <stop_token>
#include <string>
#include <thread>

namespace curlew {

inline constexpr const char* kCompressedSuffix = ".fz";

/// One idle-priority thread. NAME.fits becomes NAME.fits.fz, which is compared with it pixel for
/// pixel before NAME.fits is deleted. What goes wrong is logged and leaves NAME.fits.
class RecordingCompressor {
 public:
  /// min_free_bytes: a recording is not compressed where the disk might get to have less.
  /// log: called from the compressor's thread.
  RecordingCompressor(std::int64_t min_free_bytes, std::function<void(const std::string&)> log);

  /// Does not wait for the recordings that are still to be compressed: they stay as they are.
  ~RecordingCompressor() = default;
  RecordingCompressor(const RecordingCompressor&) = delete;
  RecordingCompressor& operator=(const RecordingCompressor&) = delete;

  /// path: a complete recording. Returns at once.
  void add(const std::string& path);

 private:
  void run(const std::stop_token& stop);
  void compress(const std::string& path, const std::stop_token& stop);

  std::int64_t min_free_bytes_;
  std::function<void(const std::string&)> log_;
  std::mutex mutex_;
  std::condition_variable_any ready_;
  std::deque<std::string> paths_;
  std::jthread thread_;  // the last member: it uses the others
};

}  // namespace curlew
