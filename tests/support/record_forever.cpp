// record_forever FOLDER records numbered frames, one per millisecond, until it is killed. It prints
// the number of each frame once it is handed in, and the microseconds since the first.
#include <unistd.h>

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <string>
#include <thread>

#include "service/recorder/recorder.h"
#include "tests/support/numbered_frames.h"

int main(int argc, char** argv) try {
  using namespace curlew;
  if (argc != 2) return 2;
  FrameFormat format;
  format.rows = 60;
  format.cols = 80;
  RecorderOptions options;
  options.mode = RecordMode::kContinuous;
  options.folder = argv[1];
  options.memory_mb = 16;
  options.max_file_s = 0.4;  // At 1 kHz by their own stamps a file takes 400 frames.
  options.min_free_mb = 10;
  Recorder recorder(options, format, RecordingHeader{}, [](const std::string&) {});
  FrameBuffer frame(format);
  const auto start = std::chrono::steady_clock::now();
  for (std::int64_t n = 0;; ++n) {
    fill_numbered(frame, n);
    recorder.add(frame);
    const auto now = std::chrono::steady_clock::now();
    const std::string line =
        std::to_string(n) + " " +
        std::to_string(std::chrono::duration_cast<std::chrono::microseconds>(now - start).count()) +
        "\n";
    if (write(STDOUT_FILENO, line.data(), line.size()) < 0) return 1;
    std::this_thread::sleep_until(start + std::chrono::milliseconds(n + 1));
  }
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
