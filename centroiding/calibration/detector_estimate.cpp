#include "centroiding/calibration/detector_estimate.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "centroiding/calibration/photon_transfer.h"
#include "centroiding/calibration/sentence.h"
#include "centroiding/calibration/spot_picture.h"

namespace curlew {
namespace {

/// Returns the noise of one frame between the spots, in ADU. Over frames it is the median variance
/// there. Where no dark is subtracted the pattern of the detector adds to it, as far as the scatter
/// of neighbours in the mean frame is more than that noise leaves.
double noise_between_spots(const CalibrationInput& input, const FoundGrid& found,
                           const PhotonTransfer& transfer) {
  if (input.reference_variance_adu2.empty()) {
    return found.noise_adu * std::sqrt(input.reference_frames);
  }
  Image<float> variance = input.reference_variance_adu2;
  fill_bad_pixels(variance, input.bad_pixel, 0.0F);
  const double over_frames = measure_between_spots(variance, found.grid).median_adu *
                             mean_of_median_variance(input.reference_frames);
  const double pattern =
      std::max(found.noise_adu * found.noise_adu - over_frames / input.reference_frames, 0.0);
  const double seen = std::sqrt(over_frames + pattern);
  // What is clipped at one value shows less noise than it has.
  if (transfer.clipped && transfer.noise_adu > seen) return transfer.noise_adu;
  return seen;
}

/// Sets e⁻ per ADU where it was not given. `noise_adu` is that of one frame between the spots.
void estimate_gain(Detector& detector, const CalibrationInput& input,
                   const PhotonTransfer& transfer, double noise_adu,
                   std::vector<std::string>& notes) {
  if (!std::isnan(transfer.e_per_adu)) {
    detector.e_per_adu = transfer.e_per_adu;
    notes.push_back(say("e- per ADU was not given and is estimated as ", transfer.e_per_adu,
                        " from how the noise of ", input.reference_frames,
                        " reference frames grows with their light (--e-per-adu)"));
    return;
  }
  // Whole numbers are mostly counts of a few electrons. Of any other unit the noise alone tells a
  // scale.
  constexpr double kUsualReadNoiseE = 3.0;
  const bool counts = input.adu_per_count == 1.0 && input.value_step == 1;
  detector.e_per_adu = counts || !(noise_adu > 0.0) ? 1.0 : kUsualReadNoiseE / noise_adu;
  notes.push_back(say("e- per ADU was not given and is taken as ", detector.e_per_adu,
                      counts ? "" : ", as if the noise between the spots were 3 electrons",
                      ": variances from photon noise are a guess (--e-per-adu, or calibrate on ",
                      "several frames, which tell it)"));
}

/// Compares the gain that was given with the one that the frames show.
void check_gain(Detector& detector, const CalibrationInput& input, const PhotonTransfer& transfer,
                std::vector<std::string>& notes) {
  constexpr double kApart = 2.0;
  const double given = detector.e_per_adu;
  const double seen = transfer.e_per_adu;
  if (std::isnan(seen)) return;
  const auto distance = [seen](double gain) { return std::abs(std::log(gain / seen)); };
  if (input.value_step > 1 && distance(given / input.value_step) < distance(given)) {
    detector.e_per_adu = given / input.value_step;
    notes.push_back(
        say("the ", given, " e- per ADU that were given are those of a step of ", input.value_step,
            ", as the noise of the frames shows: ", detector.e_per_adu, " a unit of the file"));
    return;
  }
  if (distance(given) > std::log(kApart)) {
    notes.push_back(say("the noise of the reference frames grows with their light as if a unit ",
                        "were ", seen, " electrons, but ", given,
                        " were given: check --e-per-adu, or the light flickers"));
  }
}

}  // namespace

Detector complete_detector(const CalibrationInput& input, const FoundGrid& found,
                           const Image<float>& light_adu, std::vector<std::string>& notes) {
  Detector detector = input.detector;
  if (input.value_step > 1) {
    notes.push_back(say("all values are multiples of ", input.value_step,
                        ": the camera writes its bits left-justified, which changes nothing but ",
                        "the unit"));
  }
  const PhotonTransfer transfer = measure_photon_transfer(light_adu, input.reference_variance_adu2,
                                                          input.reference_frames, input.bad_pixel);
  if (transfer.clipped) {
    notes.emplace_back(
        "many pixels rest at the lowest value: the background is clipped, raise the camera's "
        "black level to see faint light");
  }
  double noise_adu = noise_between_spots(input, found, transfer);
  if (std::isnan(detector.e_per_adu)) {
    estimate_gain(detector, input, transfer, noise_adu, notes);
  } else {
    check_gain(detector, input, transfer, notes);
  }
  if (!std::isnan(detector.read_noise_e)) return detector;
  if (!input.dark_variance_adu2.empty()) {
    std::vector<float> variances;
    for (const float v : input.dark_variance_adu2) {
      if (std::isfinite(v)) variances.push_back(v);
    }
    const double dark_adu = std::sqrt(quantile(std::move(variances), 0.5));
    if (dark_adu > 0.0) noise_adu = dark_adu;
    notes.push_back(say("read noise ", noise_adu, " ADU, measured from the stack of darks"));
  } else {
    notes.push_back(say("read noise was not given and is estimated as ", noise_adu,
                        " ADU from the scatter between the spots (--read-noise-e)"));
  }
  detector.read_noise_e = noise_adu * detector.e_per_adu;
  return detector;
}

}  // namespace curlew
