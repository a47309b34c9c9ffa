// PacedCamera: a recording or the simulator that sends frames at its own rate, as a camera does.
#pragma once

#include <memory>
#include <string>

#include "acquisition/camera.h"
#include "acquisition/frame_source.h"
#include "acquisition/simulator/simulator_options.h"

namespace curlew {

/// What a PacedCamera says of itself.
struct PacedCameraNature {
  std::string description;
  Optics optics;
  Detector detector;
};

/// Sends the frames of the source at rate_hz and does not wait for anybody: where no buffer is
/// free the frame is lost, and counted. Frame numbers count from 0. Closes the exchange after the
/// last frame.
std::unique_ptr<Camera> make_paced_camera(std::unique_ptr<FrameSource> source, double rate_hz,
                                          PacedCameraNature nature, ThreadStart thread_start);

/// The recording, once. rate_hz 0: 1000 Hz.
std::unique_ptr<Camera> open_file_camera(const std::string& path, double rate_hz,
                                         const ThreadStart& thread_start);

/// Simulated frames of a preset, drawn beforehand and sent over and over, without end. rate_hz 0:
/// 1000 Hz.
std::unique_ptr<Camera> open_simulated_camera(const std::string& preset, double rate_hz,
                                              const ThreadStart& thread_start);

/// The options open_simulated_camera() simulates a preset with: 16×16 lenslets, seed 1.
SimulatorOptions simulated_camera_options(const std::string& preset);

}  // namespace curlew
