// RecordingCompressor compresses complete recordings behind whatever else needs the processor.
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

/// It has one thread, with a nice of 10: where other work uses all processors it goes on slowly, so
/// that uncompressed files do not pile up. From NAME.fits it makes NAME.fits.fz, compares the two
/// pixel for pixel, and only then deletes NAME.fits. Where something goes wrong, that is logged and
/// NAME.fits stays.
class RecordingCompressor {
 public:
  /// min_free_bytes: a recording is not compressed where the disk might get to have less than this.
  /// log: the compressor's thread calls it with one sentence at a time.
  RecordingCompressor(std::int64_t min_free_bytes, std::function<void(const std::string&)> log);

  /// It does not wait for the recordings that are not compressed yet: they stay as they are.
  ~RecordingCompressor() = default;
  RecordingCompressor(const RecordingCompressor&) = delete;
  RecordingCompressor& operator=(const RecordingCompressor&) = delete;

  /// Takes the path of a complete recording, and returns at once.
  void add(const std::string& path);

 private:
  void run(const std::stop_token& stop);
  void compress(const std::string& path, const std::stop_token& stop);

  std::int64_t min_free_bytes_;
  std::function<void(const std::string&)> log_;
  std::mutex mutex_;
  std::condition_variable_any ready_;
  std::deque<std::string> paths_;
  std::jthread thread_;  // It is the last member, because it uses the others.
};

}  // namespace curlew
