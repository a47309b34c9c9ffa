#include "detect/classifier/vortex_classifier.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>

#include "acquisition/simulator/random_stream.h"
#include "acquisition/simulator/simulator.h"
#include "centroiding/centroid.h"
#include "centroiding/slopes.h"
#include "core/error.h"
#include "detect/circulation.h"
#include "detect/classifier/matrix_product.h"
#include "service/bench/bench_frames.h"
#include "service/spot_camera.h"
#include "tests/support/sanitized.h"

namespace curlew {
namespace {

constexpr int kFieldLenslets = 16;
constexpr int kWindowPx = 6;
constexpr int kSide = kFieldLenslets * kWindowPx;
constexpr double kBiasAdu = 100.0;
constexpr double kEPerAdu = 0.25;
constexpr std::uint64_t kFieldSeed = 20260711;

Sensor sensor_of_test() {
  Sensor sensor = tiled_sensor({kFieldLenslets, kFieldLenslets, kWindowPx});
  sensor.optics = {.pitch_m = 1e-4,
                   .focal_m = 1e-2,
                   .pixel_m = 1e-5,
                   .wavelength_m = 2e-7,  // This makes two pixels a λ/w.
                   .magnification = 1.0,
                   .mirrored = false};
  sensor.detector = {
      .e_per_adu = kEPerAdu, .read_noise_e = 1.0, .saturation_adu = kUnknown, .bit_depth = 16};
  sensor.background_adu = kBiasAdu;
  return sensor;
}

FrameFormat format_of_test() {
  FrameFormat format;
  format.rows = format.cols = kSide;
  return format;
}

/// Returns the expected electrons of every pixel.
Image<float> light_of(const Scene& scene, double photons) {
  SimulatorOptions options;
  options.rows = options.cols = kFieldLenslets;
  options.window_px = kWindowPx;
  options.photons = photons;
  options.scene = scene;
  Simulator simulator(options);
  return simulator.expected_image_e(0);
}

Scene vortex_scene(double x, double y, int charge) {
  Scene scene;
  scene.vortices = {{.x = x, .y = y, .charge = charge}};
  scene.vortex_amplitude = VortexAmplitude::kLinearCore;
  scene.core_radius = 2.0;
  return scene;
}

/// Holds the stages from pixels to vortices.
struct Chain {
  explicit Chain(const ClassifierOptions& options = {},
                 const ClassifierNetwork& network = shipped_classifier_network())
      : plan(options, spot_camera(sensor), format_of_test(), network) {}

  void expose(const Image<float>& light, std::uint64_t seed) {
    RandomStream random(seed, 0);
    auto* counts = reinterpret_cast<std::uint16_t*>(frame.data());
    for (std::size_t k = 0; k < light.size(); ++k) {
      const double electrons = random.poisson(static_cast<double>(light[k])) + random.gaussian();
      counts[k] = static_cast<std::uint16_t>(std::lround(kBiasAdu + electrons / kEPerAdu));
    }
    centroid();
  }
  void centroid() {
    find_centroids(centroid_plan, frame.view(), centroids);
    measure_slopes(slope_plan, centroids, slopes);
    circulate(slopes, circulation);
  }
  const VortexList& classify() {
    find_classified_vortices(plan, frame.view(), {}, centroids, circulation, workspace, vortices);
    return vortices;
  }

  Sensor sensor = sensor_of_test();
  CentroidPlan centroid_plan{
      sensor, format_of_test(), {.threshold_noise = 3.0, .min_snr = 0.0, .edge_fraction = 0.0}};
  SlopePlan slope_plan{sensor};
  ClassifierPlan plan;
  ClassifierWorkspace workspace{plan};
  FrameBuffer frame{format_of_test()};
  Centroids centroids{kFieldLenslets, kFieldLenslets};
  SlopeField slopes{kFieldLenslets, kFieldLenslets};
  CirculationMap circulation{kFieldLenslets, kFieldLenslets};
  VortexList vortices{64};
};

TEST(VortexClassifier, PlaneWavesHaveNoVortex) {
  Scene tilted;
  tilted.tilt_x_rad = 0.4;
  tilted.tilt_y_rad = -0.3;
  for (const Scene& scene : {Scene{}, tilted}) {
    for (const double photons : {200.0, 1000.0, 10000.0}) {
      const Image<float> light = light_of(scene, photons);
      Chain chain;
      for (std::uint64_t seed = kFieldSeed; seed < kFieldSeed + 10; ++seed) {
        chain.expose(light, seed);
        EXPECT_TRUE(chain.classify().empty()) << photons << " photons, seed " << seed;
      }
    }
  }
}

TEST(VortexClassifier, FindsVorticesWithTheirSign) {
  for (const int charge : {1, -1}) {
    for (const double x : {5.5, 7.2, 8.0}) {
      for (const double y : {6.5, 9.1}) {
        Chain chain;
        chain.expose(light_of(vortex_scene(x, y, charge), 4000.0), kFieldSeed);
        const VortexList& found = chain.classify();
        ASSERT_EQ(found.size(), 1U) << x << ", " << y;
        EXPECT_EQ(found[0].charge, charge);
        EXPECT_NEAR(static_cast<double>(found[0].x), x, 0.3);
        EXPECT_NEAR(static_cast<double>(found[0].y), y, 0.3);
        EXPECT_GT(found[0].variance_x, 0.0F);
        EXPECT_GT(found[0].variance_x * found[0].variance_y,
                  found[0].covariance_xy * found[0].covariance_xy);
      }
    }
  }
}

TEST(VortexClassifier, FollowsRotationAndMirror) {
  // The orientations were learned from examples of all eight and are not built in, hence the
  // tolerances.
  const Image<float> light = light_of(vortex_scene(6.8, 9.3, 1), 4000.0);
  Chain upright;
  upright.expose(light, kFieldSeed);
  ASSERT_EQ(upright.classify().size(), 1U);
  const Vortex seen = upright.vortices[0];
  const auto* counts = reinterpret_cast<const std::uint16_t*>(upright.frame.data());
  for (const bool transposed : {false, true}) {
    for (const bool mirrored : {false, true}) {
      Chain turned;
      auto* to = reinterpret_cast<std::uint16_t*>(turned.frame.data());
      for (int i = 0; i < kSide; ++i) {
        for (int j = 0; j < kSide; ++j) {
          const int row = transposed ? j : i;
          const int col = transposed ? i : j;
          to[row * kSide + (mirrored ? kSide - 1 - col : col)] = counts[i * kSide + j];
        }
      }
      turned.centroid();
      ASSERT_EQ(turned.classify().size(), 1U);
      const Vortex& found = turned.vortices[0];
      const float x = transposed ? seen.y : seen.x;
      const float y = transposed ? seen.x : seen.y;
      EXPECT_EQ(found.charge, transposed != mirrored ? -seen.charge : seen.charge);
      EXPECT_NEAR(found.x, mirrored ? kFieldLenslets - 1 - x : x, 0.15F);
      EXPECT_NEAR(found.y, y, 0.15F);
    }
  }
}

TEST(VortexClassifier, NeverReportsOneVortexTwice) {
  Chain chain({.min_probability = 0.02});
  RandomStream random(kFieldSeed, 0);
  std::size_t reported = 0;
  for (int trial = 0; trial < 20; ++trial) {
    Scene scene = vortex_scene(3.0 + 9.0 * random.uniform(), 3.0 + 9.0 * random.uniform(), 1);
    scene.vortices.push_back({.x = 12.0 * random.uniform(), .y = 2.0, .charge = -1});
    chain.expose(light_of(scene, 300.0), kFieldSeed + static_cast<std::uint64_t>(trial));
    const VortexList& found = chain.classify();
    reported += found.size();
    for (const Vortex& a : found) {
      for (const Vortex& b : found) {
        if (&a == &b || a.charge != b.charge) continue;
        EXPECT_GT(std::hypot(a.x - b.x, a.y - b.y), 0.3F);
      }
    }
  }
  EXPECT_GT(reported, 20U);
}

TEST(VortexClassifier, ReportsAPairOrItsVorticesNeverBoth) {
  Chain chain({.min_probability = 0.02});
  RandomStream random(kFieldSeed, 1);
  int pairs = 0;
  for (int trial = 0; trial < (kSanitized ? 20 : 60); ++trial) {
    const double x = 4.0 + 7.0 * random.uniform();
    const double y = 4.0 + 7.0 * random.uniform();
    Scene scene = vortex_scene(x - 0.3, y, 1);
    scene.vortices.push_back({.x = x + 0.3, .y = y, .charge = -1});
    chain.expose(light_of(scene, 2000.0), kFieldSeed + static_cast<std::uint64_t>(trial));
    for (const Vortex& pair : chain.classify()) {
      EXPECT_EQ(pair.charge == 0, (pair.flags & kVortexUnresolvedPair) != 0);
      if (pair.charge != 0) continue;
      ++pairs;
      EXPECT_GE(pair.probability, 0.5F);
      EXPECT_NEAR(static_cast<double>(pair.x), x, 1.0);
      EXPECT_NEAR(static_cast<double>(pair.y), y, 1.0);
      for (const Vortex& other : chain.vortices) {
        if (other.charge == 0) continue;
        EXPECT_GT(std::hypot(pair.x - other.x, pair.y - other.y), 0.2F);
      }
    }
  }
  EXPECT_GT(pairs, 0);
}

TEST(VortexClassifier, LivesWithMissingLensletsAndAnyPixels) {
  Chain chain({.min_probability = 0.02});
  RandomStream random(kFieldSeed, 0);
  auto* counts = reinterpret_cast<std::uint16_t*>(chain.frame.data());
  std::size_t reported = 0;
  for (int trial = 0; trial < 40; ++trial) {
    for (int k = 0; k < kSide * kSide; ++k)
      counts[k] = static_cast<std::uint16_t>(random.uniform() * (trial % 4 == 0 ? 65536.0 : 130.0));
    chain.centroid();
    for (std::size_t k = 0; k < chain.centroids.state.size(); ++k) {
      if (random.uniform() < 0.05 * trial / 4)
        chain.centroids.state[k] = k % 2 == 0 ? LensletState::kSaturated : LensletState::kUnlit;
    }
    for (const Vortex& vortex : chain.classify()) {
      ++reported;
      EXPECT_TRUE(vortex.x >= 0.0F && vortex.x <= kFieldLenslets - 1);
      EXPECT_TRUE(vortex.y >= 0.0F && vortex.y <= kFieldLenslets - 1);
      EXPECT_TRUE(vortex.probability >= 0.02F && vortex.probability <= 1.0F);
      EXPECT_TRUE(std::isfinite(vortex.variance_x) && std::isfinite(vortex.variance_y));
    }
  }
  EXPECT_GT(reported, 0U);
  chain.centroids.state.fill(LensletState::kUnlit);
  EXPECT_TRUE(chain.classify().empty());
}

/// This shows what speed costs: fixed point, and nodes that the screen drops.
TEST(VortexClassifier, FindsWhatItWasTrainedToFind) {
  Chain exact({.min_probability = 0.3, .as_trained = true});
  Chain unscreened({.min_probability = 0.3, .min_screen = 2.0 * kEveryNode});
  Chain fast({.min_probability = 0.3});
  std::size_t found = 0;
  std::size_t judged = 0;
  std::size_t judged_exactly = 0;
  for (int trial = 0; trial < 6; ++trial) {
    const std::uint64_t seed = kFieldSeed + static_cast<std::uint64_t>(trial);
    Scene scene = vortex_scene(5.2 + 0.4 * trial, 6.9 - 0.3 * trial, trial % 2 == 0 ? 1 : -1);
    scene.vortices.push_back({.x = 11.3, .y = 10.6 + 0.2 * trial, .charge = 1});
    const Image<float> light = light_of(scene, 300.0);
    for (Chain* chain : {&exact, &unscreened, &fast}) {
      chain->expose(light, seed);
      chain->classify();
    }
    ASSERT_EQ(unscreened.vortices.size(), exact.vortices.size()) << "seed " << seed;
    ASSERT_EQ(fast.vortices.size(), exact.vortices.size()) << "seed " << seed;
    for (std::size_t i = 0; i < exact.vortices.size(); ++i) {
      const Vortex& expected = exact.vortices[i];
      const auto among = [&](const VortexList& others, float apart, float probability) {
        return std::any_of(others.begin(), others.end(), [&](const Vortex& other) {
          return other.charge == expected.charge &&
                 std::hypot(other.x - expected.x, other.y - expected.y) < apart &&
                 std::abs(other.probability - expected.probability) < probability;
        });
      };
      EXPECT_TRUE(among(unscreened.vortices, 0.01F, 0.01F)) << "seed " << seed;
      // One view fewer moves the mean of the views, but by less than its standard deviation.
      EXPECT_TRUE(among(fast.vortices, 0.3F, 1.0F)) << "seed " << seed;
      ++found;
    }
    EXPECT_TRUE(std::equal(exact.workspace.nodes.begin(), exact.workspace.nodes.end(),
                           unscreened.workspace.nodes.begin(), unscreened.workspace.nodes.end()));
    EXPECT_TRUE(std::includes(exact.workspace.nodes.begin(), exact.workspace.nodes.end(),
                              fast.workspace.nodes.begin(), fast.workspace.nodes.end()));
    EXPECT_LE(fast.workspace.measured.count, exact.workspace.measured.count);
    judged += fast.workspace.nodes.size();
    judged_exactly += exact.workspace.nodes.size();
  }
  EXPECT_GE(found, 6U);
  EXPECT_LT(judged, judged_exactly);
}

TEST(VortexClassifier, SameFrameSameBits) {
  Chain first;
  Chain second;
  first.expose(light_of(vortex_scene(3.0, 4.0, 1), 1000.0), kFieldSeed + 1);
  first.classify();  // It leaves its workspace used.
  const Image<float> light = light_of(vortex_scene(7.1, 8.4, -1), 1000.0);
  first.expose(light, kFieldSeed);
  second.expose(light, kFieldSeed);
  const VortexList& a = first.classify();
  const VortexList& b = second.classify();
  ASSERT_EQ(a.size(), b.size());
  ASSERT_FALSE(a.empty());
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a[i].x, b[i].x);
    EXPECT_EQ(a[i].y, b[i].y);
    EXPECT_EQ(a[i].probability, b[i].probability);
  }
}

TEST(VortexClassifier, RefusesWhatItCannotUse) {
  const Sensor sensor = sensor_of_test();
  SpotCamera camera = spot_camera(sensor);
  EXPECT_THROW(ClassifierPlan({.min_probability = 0.0}, camera, format_of_test()), UsageError);
  EXPECT_THROW(ClassifierPlan({.min_screen = std::nan("")}, camera, format_of_test()), UsageError);
  camera.pixels_per_lambda_w = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(ClassifierPlan({}, camera, format_of_test()), Failure);
  const std::array<float, 3> few{};
  EXPECT_THROW(ClassifierNetwork{few}, Failure);
}

/// Returns what the shipped judge or reviewer says of made-up features.
AlignedVector<float> answers_of(const JudgeLayers& judge) {
  ClassifierNetwork network = shipped_classifier_network();
  DenseLayer& first = network.layers[static_cast<std::size_t>(judge.encoder)];
  first = layer_for_sensor(first, SensorTraits{}, 0.0);
  AlignedVector<float> in(kPatchLenslets * kSpotFeatures);
  for (std::size_t i = 0; i < in.size(); ++i) in[i] = 0.1F * static_cast<float>(i % 7) - 0.2F;
  for (int i = judge.encoder; i < judge.end; ++i) {
    const DenseLayer& layer = network.layers[static_cast<std::size_t>(i)];
    const int samples = i < judge.head ? kPatchLenslets : 1;
    AlignedVector<float> out(static_cast<std::size_t>(samples * layer.outputs));
    multiply({in.data(), layer.inputs, 1}, layer.weights.data(), layer.bias.data(), samples,
             layer.inputs, layer.outputs, ClassifierNetwork::rectified(i), out.data());
    in = out;
  }
  return in;
}

TEST(ClassifierNetwork, ShippedWeightsGiveWhatTheyGave) {
  struct Case {
    JudgeLayers judge;
    std::array<float, 3> logit_and_place;
  };
  for (const Case& which :
       {Case{ClassifierNetwork::kJudge, {-2.92448e+00F, 2.00255e-01F, 4.96653e-02F}},
        Case{ClassifierNetwork::kReviewer, {-1.41042e+00F, 5.74882e-02F, 7.33290e-03F}}}) {
    const AlignedVector<float> answers = answers_of(which.judge);
    // Float rounding differs between instruction sets.
    for (std::size_t i = 0; i < which.logit_and_place.size(); ++i) {
      const float expected = which.logit_and_place[i];
      EXPECT_NEAR(answers[i], expected, 1e-3F * (1.0F + std::abs(expected)));
    }
  }
}

/// A reviewer that knows nothing, which halves every logit.
TEST(VortexClassifier, AReviewedAnswerIsTheMeanOfBoth) {
  ClassifierNetwork network = shipped_classifier_network();
  DenseLayer& last = network.layers.back();
  std::fill(last.weights.begin(), last.weights.end(), 0.0F);
  std::fill(last.bias.begin(), last.bias.end(), 0.0F);
  const auto surest = [&](double min_review) {
    Chain chain({.min_probability = 0.02, .min_review = min_review}, network);
    chain.expose(light_of(vortex_scene(5.2, 6.9, 1), 1000.0), kFieldSeed);
    const VortexList& found = chain.classify();
    return found.empty() ? Vortex{} : *found.begin();
  };
  const auto logit_of = [](const Vortex& v) {
    return std::log(v.probability / (1 - v.probability));
  };
  const Vortex judged = surest(kNoNode);
  const Vortex reviewed = surest(ClassifierOptions{}.min_review);
  EXPECT_GT(judged.probability, 0.9F);
  EXPECT_NEAR(logit_of(reviewed), 0.5F * logit_of(judged), 0.01F * logit_of(judged));
  // Nothing that the judge sees is above this.
  EXPECT_EQ(surest(logit_of(judged) + 5.0F).probability, judged.probability);
}

TEST(SpotFeatures, ModesTurnAsPicturesDo) {
  for (int i = 0; i < kSpotModes; ++i) {
    const SpotMode mode = spot_mode(i);
    EXPECT_EQ(spot_mode_index(mode), i);
    EXPECT_LE(mode.m + mode.n, kHighestOrder);
  }
  const SpotFeatures features(spot_camera(sensor_of_test()), format_of_test());
  FrameBuffer frame(format_of_test());
  auto* counts = reinterpret_cast<std::uint16_t*>(frame.data());
  RandomStream random(kFieldSeed, 0);
  for (int i = 0; i < kWindowPx; ++i) {
    for (int j = 0; j < kWindowPx; ++j) {
      const auto count = static_cast<std::uint16_t>(kBiasAdu + 1000.0 * random.uniform());
      // Lenslet 1 is lenslet 0 transposed, and lenslet 2 is lenslet 0 mirrored.
      counts[i * kSide + j] = count;
      counts[j * kSide + kWindowPx + i] = count;
      counts[i * kSide + 2 * kWindowPx + kWindowPx - 1 - j] = count;
    }
  }
  std::array<std::array<float, kSpotFeatures>, 3> spot{};
  for (std::size_t k = 0; k < 3; ++k)
    features.measure(frame.view(), {}, k, 100.0F, 100.0F, spot[k].data());
  for (int i = 0; i < kSpotModes; ++i) {
    const SpotMode mode = spot_mode(i);
    const auto u = static_cast<std::size_t>(i);
    const auto turned = static_cast<std::size_t>(spot_mode_index({mode.n, mode.m}));
    // The tolerance is for the float rounding of sums over 36 pixels.
    EXPECT_NEAR(spot[1][u], spot[0][turned], 1e-5F);
    EXPECT_NEAR(spot[2][u], (mode.m % 2 == 0 ? 1.0F : -1.0F) * spot[0][u], 1e-5F);
  }
}

}  // namespace
}  // namespace curlew
