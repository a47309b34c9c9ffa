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
  /// The exposure at which the source's frames were taken, µs. With another one the camera sends
  /// what lies above bias_adu in proportion, up to saturation. 0: the exposure cannot be set.
  double exposure_us = 0.0;
  double bias_adu = 0.0;
};

/// Says how a PacedCamera sends its frames.
struct Pace {
  double rate_hz = 0.0;  ///< 0 means 1000 Hz
  /// The time from a frame's first row to its last, as of a rolling shutter; the pipeline gets each
  /// row when it is due. 0: a frame comes whole. Throws UsageError if it is longer than a period.
  double readout_us = 0.0;
};

/// Makes a camera that sends the frames of the source at a pace and waits for nobody: if no buffer
/// is free, the frame is lost and counted. Frame numbers count from 0. The camera closes the
/// exchange after the last frame. A frame whose readout the stop of the camera breaks off counts as
/// aborted.
std::unique_ptr<Camera> make_paced_camera(std::unique_ptr<FrameSource> source, const Pace& pace,
                                          PacedCameraNature nature, ThreadStart thread_start);

/// Opens a recording as a camera that sends it once. Throws what FitsSource throws.
std::unique_ptr<Camera> open_file_camera(const std::string& path, const Pace& pace,
                                         const ThreadStart& thread_start);

/// Opens a camera of simulated frames of a preset, 100 of which are drawn and sent over and over,
/// without end, as if exposed for 1000 µs. Behind turbulence the camera starts with the first of
/// them and draws the others meanwhile. Throws UsageError for an unknown preset.
std::unique_ptr<Camera> open_simulated_camera(const std::string& preset, const Pace& pace,
                                              const ThreadStart& thread_start);

/// Returns the options with which open_simulated_camera() simulates a preset: 16×16 lenslets, seed
/// 1.
SimulatorOptions simulated_camera_options(const std::string& preset);

}  // namespace curlew
