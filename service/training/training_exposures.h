// What the vortex classifier is shown: fields behind every kind of sensor that it has to know.
#pragma once

#include <cstdint>

#include "acquisition/simulator/random_stream.h"
#include "core/image.h"
#include "detect/classifier/sensor_encoder.h"
#include "service/bench/detection_measurement.h"
#include "service/training/training_fields.h"

namespace curlew {

/// A block of a field's lenslets behind one sensor, before noise.
struct DrawnSensor {
  bool usual = true;           ///< the benchmark's
  FieldParameters parameters;  ///< of the block: its lenslets, its pixels
  double told_blur = 0.0;      ///< λ/w; what the network is told
  float reference_x_px = 0;    ///< a flat wave's spot in its window
  float reference_y_px = 0;
  int first_row = 0;  ///< the field's lenslet that is the block's first
  int first_col = 0;
  Image<float> light;  ///< as Realisation::light
  Image<std::uint8_t>
      missing;  ///< 1: no evidence, since neither it nor half of those around is lit
};

/// What is in the way of seeing a block as it is.
struct DrawnNoise {
  double photons = kWithoutNoise;  ///< of a lenslet of amplitude 1
  double read_noise_e = 1.0;       ///< without noise: not known
  double sky_e = 0.0;              ///< a pixel; its mean is subtracted
  double level_error_e = 0.0;      ///< of that subtraction, rms
  double hits = 0.0;               ///< cosmic rays a lenslet
  double ghost_e = 0.0;            ///< a pixel, at the middle of a reflection
};

/// Most blocks have no more lenslets along a side than this.
inline constexpr int kBlockLenslets = 30;

/// Returns the light of all the field's lenslets, in sharp windows of ±1.5 λ/w and pixels of .5
/// λ/w as in the benchmark or, where `coarse`, in the field's whole windows and pixels of 1 λ/w.
DrawnSensor plain_sensor(const TrainingField& field, bool coarse);
/// Draws a block and a sensor. Nine of twenty are the benchmark's. The others have blurs of 0 to
/// .8 λ/w, known to .015 (λ/w)², some with up to .4 of the light in a wide skirt, pixels of .25
/// to 1.25 λ/w at any place, windows of ±1 to ±3 λ/w with or without their neighbours' light, and
/// some have dark lenslets, pupils that are smaller than the array, or lenslets of unequal
/// brightness.
DrawnSensor draw_sensor(const TrainingField& field, RandomStream& random);
/// Draws the noise. `usual`: only photons and read noise, as in the benchmark.
DrawnNoise draw_noise(bool usual, RandomStream& random);

/// The features of every lenslet in one exposure.
struct Exposure {
  int field = 0;
  int first_row = 0;
  int first_col = 0;
  SensorTraits traits;
  Image<std::uint8_t> missing;  ///< [rows, cols]
  Image<float> features;        ///< [rows, cols·kSpotFeatures]
};

/// Draws the noise of a block and measures its spots.
void expose(const DrawnSensor& sensor, const DrawnNoise& noise, RandomStream& random,
            Exposure& exposure);

}  // namespace curlew
