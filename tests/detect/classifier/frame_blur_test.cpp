// The blur of a frame is measured in its spots, and the encoder is told of it.
#include "detect/classifier/frame_blur.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <limits>

#include "acquisition/simulator/simulator.h"
#include "centroiding/slopes.h"
#include "detect/circulation.h"
#include "detect/classifier/vortex_classifier.h"
#include "service/bench/bench_frames.h"
#include "service/bench/detection_measurement.h"
#include "service/spot_camera.h"

namespace curlew {
namespace {

FieldParameters turbulence() {
  FieldParameters parameters;
  parameters.rytov_variance = 2.0;
  parameters.rows = parameters.cols = 24;
  return parameters;
}

MeasurementOptions seen(double photons, double blur) {
  MeasurementOptions options;
  options.photons = photons;
  options.blur = blur;
  return options;
}

/// Frames of one turbulent field that is blurred, seen by a classifier that was told of no blur.
struct Untold {
  explicit Untold(double blur, double photons = 1000.0)
      : plan(turbulence(), seen(photons, blur)), frame(plan) {
    static const Realisation realisation =
        simulate_realisation(turbulence(), realisation_seed(Subset::kValidation, 7));
    measure_frame(plan, realisation, 20261129, frame);
  }

  SpotCamera camera() const {
    SpotCamera camera = spot_camera(plan.sensor());
    camera.blur_lambda_w = 0.0;
    return camera;
  }

  const VortexList& classify(const ClassifierPlan& classifier, ClassifierWorkspace& workspace) {
    find_classified_vortices(classifier, frame.frame.view(), frame.shift(), frame.centroids,
                             frame.circulation, workspace, vortices);
    return vortices;
  }

  double measured_blur(const ClassifierPlan& classifier, ClassifierWorkspace& workspace) {
    const double core = typical_core_variance(
        classifier.features(), frame.frame.view(), frame.shift(), frame.centroids,
        mean_flux(frame.centroids), workspace.buffers.a.data());
    return classifier.judge().codings.blur_of(core);
  }

  MeasurementPlan plan;
  MeasuredFrame frame;
  VortexList vortices{512};
};

TEST(FrameBlur, IsMeasuredBehindTurbulence) {
  for (const double blur : {0.2, 0.4, 0.6, 0.8}) {
    Untold untold(blur, 400.0);
    const ClassifierPlan classifier({}, untold.camera(), untold.plan.format());
    ClassifierWorkspace workspace(classifier);
    EXPECT_NEAR(untold.measured_blur(classifier, workspace), blur, 0.06);
  }
}

TEST(FrameBlur, SharpSpotsBehindTurbulenceAreSeenAsCalibrated) {
  for (const double photons : {100.0, 1000.0}) {
    Untold untold(0.0, photons);
    const ClassifierPlan classifier({}, untold.camera(), untold.plan.format());
    ClassifierWorkspace workspace(classifier);
    untold.classify(classifier, workspace);
    EXPECT_EQ(workspace.judged.coding, &classifier.judge().codings.as_calibrated())
        << photons << " photons";
  }
}

TEST(FrameBlur, WhatTheCalibrationDoesNotSayOfItMakesNoVortices) {
  Untold untold(0.5);
  SpotCamera camera = untold.camera();
  const ClassifierPlan unaware({}, camera, untold.plan.format());
  ClassifierWorkspace workspace(unaware);
  const std::size_t found = untold.classify(unaware, workspace).size();
  camera.blur_lambda_w = 0.5;
  const ClassifierPlan told({}, camera, untold.plan.format());
  ClassifierWorkspace told_workspace(told);
  const std::size_t expected = untold.classify(told, told_workspace).size();
  EXPECT_GT(expected, 2U);
  EXPECT_NEAR(static_cast<double>(found), static_cast<double>(expected), 2.0);
}

TEST(FrameBlur, BeyondWhatWasTaughtNothingIsFound) {
  Untold untold(1.2);
  const ClassifierPlan classifier({}, untold.camera(), untold.plan.format());
  ClassifierWorkspace workspace(classifier);
  EXPECT_TRUE(untold.classify(classifier, workspace).empty());
  EXPECT_EQ(workspace.judged.coding, nullptr);
}

TEST(FrameBlur, UnknownOrHardlyLargerKeepsTheCalibrations) {
  Untold untold(0.0);
  SpotCamera camera = untold.camera();
  camera.blur_lambda_w = 0.4;
  const SpotCodings codings(shipped_classifier_network().layers.front(), camera, false);
  for (const double blur : {std::numeric_limits<double>::quiet_NaN(), 0.0, 0.4, 0.43})
    EXPECT_EQ(codings.find(blur), &codings.as_calibrated()) << blur;
  EXPECT_NE(codings.find(0.5), &codings.as_calibrated());
  EXPECT_GT(codings.find(0.7)->excess_spread, codings.find(0.5)->excess_spread);
  EXPECT_EQ(codings.find(1.0), nullptr);
  EXPECT_TRUE(std::isnan(codings.blur_of(std::numeric_limits<double>::quiet_NaN())));
  camera.pixels_per_lambda_w = 1.0;
  const SpotCodings coarse(shipped_classifier_network().layers.front(), camera, false);
  EXPECT_TRUE(std::isnan(coarse.blur_of(0.3))) << "coarse pixels do not tell";
}

}  // namespace
}  // namespace curlew
