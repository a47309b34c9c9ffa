#include "service/recorder/recording_compressor.h"

#include <fmt/format.h>

#include <exception>
#include <filesystem>
#include <utility>

#include "acquisition/recording/compressed_recording.h"
#include "core/polite_thread.h"
#include "service/program/version.h"

namespace curlew {

RecordingCompressor::RecordingCompressor(std::int64_t min_free_bytes,
                                         std::function<void(const std::string&)> log)
    : min_free_bytes_(min_free_bytes),
      log_(std::move(log)),
      thread_([this](const std::stop_token& stop) { run(stop); }) {}

void RecordingCompressor::add(const std::string& path) {
  {
    const std::lock_guard lock(mutex_);
    paths_.push_back(path);
  }
  ready_.notify_one();
}

void RecordingCompressor::run(const std::stop_token& stop) {
  become_polite("compressor", 10);
  while (true) {
    std::string path;
    {
      std::unique_lock lock(mutex_);
      if (!ready_.wait(lock, stop, [this] { return !paths_.empty(); })) return;
      if (stop.stop_requested()) return;
      path = std::move(paths_.front());
      paths_.pop_front();
    }
    try {
      compress(path, stop);
    } catch (const std::exception& error) {
      log_(fmt::format("{} is not compressed: {}", path, error.what()));
    }
  }
}

void RecordingCompressor::compress(const std::string& path, const std::stop_token& stop) {
  namespace fs = std::filesystem;
  const auto bytes = static_cast<std::int64_t>(fs::file_size(path));
  if (static_cast<std::int64_t>(fs::space(path).available) - bytes < min_free_bytes_) {
    log_(fmt::format("{} is not compressed: the disk has too little space for it", path));
    return;
  }
  const std::string compressed = path + kCompressedSuffix;
  if (!compress_recording(path, compressed, kProgram, stop)) return;
  const auto compressed_bytes = static_cast<double>(fs::file_size(compressed));
  fs::remove(path);
  log_(fmt::format("{} is compressed {:.2f} times", compressed,
                   static_cast<double>(bytes) / compressed_bytes));
}

}  // namespace curlew
