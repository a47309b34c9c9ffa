// A PacedCamera is a recording or the simulator that sends frames at its own rate, as a camera
// does.
#pragma once

#include <memory>
#include <string>

#include "acquisition/camera.h"
#include "acquisition/frame_source.h"
#include "acquisition/simulator/simulator_options.h"

namespace curlew {

/// Holds what a PacedCamera says of itself.
struct PacedCameraNature {
  std::string description;
  Optics optics;
  Detector detector;
};

/// Makes a camera that sends the frames of the source at rate_hz and waits for nobody: if no buffer
/// is free, the frame is lost and counted. Frame numbers count from 0. The camera closes the
/// exchange after the last frame. rate_hz 0 means 1000 Hz.
std::unique_ptr<Camera> make_paced_camera(std::unique_ptr<FrameSource> source, double rate_hz,
                                          PacedCameraNature nature, ThreadStart thread_start);

/// Opens a recording as a camera that sends it once. rate_hz 0 means 1000 Hz. Throws what
/// FitsSource throws.
std::unique_ptr<Camera> open_file_camera(const std::string& path, double rate_hz,
                                         const ThreadStart& thread_start);

/// Opens a camera of simulated frames of a preset, which are drawn beforehand and sent over and
/// over, without end. rate_hz 0 means 1000 Hz. Throws UsageError for an unknown preset.
std::unique_ptr<Camera> open_simulated_camera(const std::string& preset, double rate_hz,
                                              const ThreadStart& thread_start);

/// Returns the options with which open_simulated_camera() simulates a preset: 16×16 lenslets, seed
/// 1.
SimulatorOptions simulated_camera_options(const std::string& preset);

}  // namespace curlew
