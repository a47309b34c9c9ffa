#include "service/sensor/simulated_sensor.h"

#include "acquisition/paced_camera.h"
#include "acquisition/simulator/simulator.h"
#include "centroiding/calibration/calibrate.h"
#include "service/sensor/reference_spots.h"

namespace curlew {

Sensor simulated_sensor(const CentroidOptions& options) {
  constexpr int kFrames = 50;
  SimulatorOptions plane = simulated_camera_options("plane");
  plane.frames = kFrames;
  Simulator simulator(plane);
  FrameBuffer frame(simulator.format());
  CalibrationInput input;
  input.reference_adu = Image<float>(frame.format().rows, frame.format().cols);
  while (simulator.next(frame) == Delivery::kFrame) {
    const auto* counts = frame.view().data<std::uint16_t>();
    for (std::size_t i = 0; i < input.reference_adu.size(); ++i)
      input.reference_adu[i] += static_cast<float>(counts[i]) / kFrames;
  }
  input.reference_frames = kFrames;
  input.optics = simulator.optics();
  input.detector = simulator.detector();
  input.centroid = options;
  Sensor sensor = calibrate_sensor(input).sensor;
  Simulator again(plane);
  measure_reference_spots(again, options, sensor);
  return sensor;
}

}  // namespace curlew
