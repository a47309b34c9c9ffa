#include "service/commands/simulated_dark.h"

#include <spdlog/fmt/fmt.h>

#include "acquisition/recording/recording.h"
#include "acquisition/simulator/simulator.h"
#include "core/error.h"
#include "service/program/version.h"

namespace curlew {

void write_dark(const std::string& path, std::int64_t frames, SimulatorOptions simulated,
                const std::vector<std::string>& words) {
  constexpr double kNoPhotons = 1e-12;
  if (!is_noisy(simulated))
    throw UsageError(
        "a dark of frames without noise says nothing; state --photons, or leave --dark");
  simulated.turbulence.reset();
  simulated.scene = {};
  simulated.photons = kNoPhotons;
  simulated.background_e = 0.0;
  simulated.frames = frames;
  simulated.seed = ~simulated.seed;  // other noise than that of the frames
  Simulator simulator(simulated);
  Provenance provenance(kProgram);
  provenance.history = words;
  RecordingWriter recording(path, simulator.format(), simulator.optics(), simulator.detector(),
                            provenance);
  FrameBuffer frame(simulator.format());
  while (simulator.next(frame) == Delivery::kFrame) recording.append(frame.view(), frame.header);
  recording.commit();
  fmt::print("{}: {} frames without light\n", path, recording.frames());
}

}  // namespace curlew
