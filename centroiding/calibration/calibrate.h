// calibrate_sensor: from a reference frame to all that the pipeline knows of a sensor.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "centroiding/centroid.h"
#include "centroiding/sensor.h"
#include "core/image.h"
#include "core/optics.h"

namespace curlew {

/// What calibration starts from. Images are [rows, cols] of the detector; empty where not given.
struct CalibrationInput {
  Image<float> reference_adu;  ///< mean of the reference frames, as read: dark not subtracted
  int reference_frames = 1;    ///< how many frames that is the mean of
  Image<float> dark_adu;
  Image<float> dark_variance_adu2;  ///< over the frames of a dark stack: gives the read noise
  Image<float> flat;                ///< response on any scale; 0 or less marks a dead pixel
  Image<std::uint8_t> bad_pixel;    ///< 1 where bad
  Optics optics;                    ///< mirrored decides which way rows are counted
  Detector detector;                ///< NaN where unknown
  int offset_x_px = 0;
  int offset_y_px = 0;
  int binning = 1;
  CentroidOptions centroid;  ///< the thresholds that flux and window gain are measured with
};

struct Calibration {
  Sensor sensor;
  std::vector<std::string> notes;  ///< a sentence each: what was not given and how it was found
};

/// Finds the lenslet grid and lays a window round every spot: floor(pitch) pixels wide and high
/// (narrower where the grid is rotated), centred on the spot's nearest pixel, clipped at the rim
/// and kept if half is left; neighbours share a column or row of pixels at most.
///
/// Window gains are measured on the reference's signal max(I − background − T, 0) and corrected for
/// what coarse pixels do to that measurement on a spot modelled from the optics (window_gain.h);
/// where the optics are unknown the model is a Gaussian. Held within [0.3, 1.2] (2 for
/// methods other than the centres of gravity). A lenslet with less than 0.7 of the median measured
/// gain is left out: a smear, or a spot that the rim cuts.
///
/// References are centres of gravity over the windows, a first estimate: the caller measures them
/// again with the pipeline's own kernel. What is unknown stays NaN, except e⁻ per ADU (1) and read
/// noise (measured), each with a note.
///
/// Throws Failure as find_lenslet_grid, and where maps differ in size from the reference.
Calibration calibrate_sensor(const CalibrationInput& input);

}  // namespace curlew
