#include "service/sensor/capture.h"

#include <spdlog/fmt/fmt.h>

#include <chrono>
#include <memory>

#include "acquisition/camera.h"
#include "acquisition/open_camera.h"
#include "acquisition/recording/recording.h"
#include "core/error.h"
#include "core/utc_now.h"
#include "service/program/interrupt.h"
#include "service/program/progress.h"
#include "service/program/version.h"

namespace curlew {

void capture_frames(const CameraOptions& options, std::int64_t frames, const std::string& path) {
  using Clock = std::chrono::steady_clock;
  constexpr std::int64_t kLookUpUs = 100'000;
  constexpr double kPatienceS = 10.0;  // taken if the configuration sets no limit
  const double silence_s = longest_silence_s(options);
  const double timeout_s = silence_s > 0.0 ? silence_s : kPatienceS;
  const std::unique_ptr<Camera> camera = open_camera(options, {});
  fmt::print("{}: {} frames of {} x {} px\n", camera->description(), frames, camera->format().cols,
             camera->format().rows);
  Provenance provenance(kProgram);
  provenance.observed_ns = utc_now_ns();
  provenance.history = {"captured from " + camera->description()};
  RecordingWriter recording(path, camera->format(), camera->optics(), camera->detector(),
                            provenance);
  FrameExchange exchange(camera->format(), static_cast<std::size_t>(options.buffers) + 2);
  std::string trouble;
  {
    const Streaming streaming(*camera, exchange);
    Progress progress("capture", frames);
    auto last = Clock::now();
    while (trouble.empty() && recording.frames() < frames) {
      if (FrameBuffer* frame = exchange.take(kLookUpUs)) {
        recording.append(frame->view(), frame->header);
        exchange.give_back(frame);
        progress.step();
        last = Clock::now();
      } else if (exchange.closed()) {
        trouble =
            fmt::format("{} ended after {} frames", camera->description(), recording.frames());
        if (!camera->failure().empty()) trouble.append(": ").append(camera->failure());
      } else if (Clock::now() - last > std::chrono::duration<double>(timeout_s)) {
        trouble = fmt::format("{} sent no frame for {} s: is it waiting for a trigger?",
                              camera->description(), timeout_s);
      }
      if (interrupted()) trouble = "interrupted, nothing is written";
    }
  }
  if (!trouble.empty()) throw Failure(trouble);
  for (const std::string& note : camera->notes()) fmt::print("  {}\n", note);
  recording.commit();
}

}  // namespace curlew
