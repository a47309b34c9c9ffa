// calibrate_sensor() makes, from a reference frame, all that the pipeline knows of a sensor.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "centroiding/centroid.h"
#include "centroiding/sensor.h"
#include "core/image.h"
#include "core/optics.h"

namespace curlew {

/// Calibration starts from these. Images are [rows, cols] of the detector, and empty where not
/// given.
struct CalibrationInput {
  Image<float> reference_adu;  ///< mean of the reference frames, as read: dark not subtracted
  int reference_frames = 1;    ///< number of frames of which that is the mean
  Image<float> reference_variance_adu2;  ///< over those frames; tells e⁻ per ADU
  double adu_per_count = 1.0;            ///< what a count of the frames is worth in ADU
  int value_step = 1;  ///< all values are multiples of it, as of 12 bits in the upper part of 16
  Image<float> dark_adu;
  Image<float> dark_variance_adu2;  ///< over the frames of a dark stack; gives the read noise
  Image<float> flat;                ///< response on any scale; 0 or less marks a dead pixel
  Image<std::uint8_t> bad_pixel;    ///< 1 where bad
  Optics optics;                    ///< `mirrored` decides which way rows are counted
  Detector detector;                ///< NaN where unknown
  int offset_x_px = 0;
  int offset_y_px = 0;
  int binning = 1;
  int pixel_bits = 0;  ///< see Sensor
  /// Each lenslet's light ends at its window, as in simulated frames: no neighbour's comes in.
  bool light_is_cut = false;
  CentroidOptions centroid;  ///< thresholds with which flux and window gain are measured
};

struct Calibration {
  Sensor sensor;
  /// The median level between the spots, above the sensor's dark, that was taken off the reference.
  double level_adu = 0.0;
  double width_over_diffraction = kUnknown;  ///< of the typical spot; NaN where it is not known
  /// Each note is a sentence that says what was not given and how it was found.
  std::vector<std::string> notes;
};

/// Finds the lenslet grid and lays a window round every spot. A window is floor(pitch) pixels wide
/// and high (narrower where the grid is rotated) and centred on the spot's nearest pixel. The
/// detector's rim clips it, and a window of which less than half is left is dropped. Neighbours
/// share at most one column or row of pixels.
///
/// Window gains are those of the reference's signal max(I − background − T, 0) when the picture is
/// moved under its window. Where spots are too small for that, or light is cut, they are measured
/// at the window's edge and corrected on a spot modelled from the optics (window_gain.h); where the
/// optics are not known the model is a Gaussian. Gains are held within
/// [0.3, 1.2], or up to 2 for methods other than the centres of gravity. A lenslet with less than
/// 0.7 of the median measured gain is left out, because its spot is a smear or is cut by the rim.
///
/// References are centres of gravity over the windows. They are a first estimate, and the caller
/// measures them again with the pipeline's own kernel. What is not known stays NaN, except e⁻ per
/// ADU and the read noise, which are estimated (detector_estimate.h), each with a note.
///
/// Throws Failure as find_lenslet_grid() does, and where a map differs in size from the reference
/// or the flat has no pixel above 0; where the pitch or the spots contradict the optics
/// (optics_check.h); and where more than a tenth of the spots are saturated.
Calibration calibrate_sensor(const CalibrationInput& input);

}  // namespace curlew
