#include "acquisition/simulator/simulator.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>
#include <string>
#include <vector>

#include "acquisition/fits/fits_file.h"
#include "core/error.h"
#include "tests/support/constants.h"
#include "tests/support/frame_bytes.h"
#include "tests/support/scratch_directory.h"

namespace curlew {
namespace {

// Returns the mean light in one lenslet's window, in electrons.
double light_in_window(const Image<float>& image, int window_px, int row, int col) {
  double sum = 0.0;
  for (int i = 0; i < window_px; ++i) {
    for (int j = 0; j < window_px; ++j) {
      sum += static_cast<double>(image(row * window_px + i, col * window_px + j));
    }
  }
  return sum;
}

SimulatorOptions small_options() {
  SimulatorOptions options;
  options.rows = 4;
  options.cols = 6;
  options.frames = 3;
  return options;
}

TEST(Simulator, SameSeedSameBytesOtherSeedOthers) {
  SimulatorOptions options = small_options();
  Simulator a(options);
  Simulator b(options);
  options.seed = 2;
  Simulator c(options);
  FrameBuffer from_a(a.format());
  FrameBuffer from_b(b.format());
  FrameBuffer from_c(c.format());
  std::vector<std::byte> previous;
  for (int k = 0; k < 3; ++k) {
    ASSERT_EQ(a.next(from_a), Delivery::kFrame);
    ASSERT_EQ(b.next(from_b), Delivery::kFrame);
    ASSERT_EQ(c.next(from_c), Delivery::kFrame);
    const auto bytes = bytes_of(from_a, a.format());
    EXPECT_EQ(bytes, bytes_of(from_b, b.format()));
    EXPECT_NE(bytes, bytes_of(from_c, c.format()));
    EXPECT_NE(bytes, previous);
    previous = bytes;
    EXPECT_EQ(from_a.header.sequence, k);
    EXPECT_EQ(from_a.rows_ready.load(), a.format().rows);
  }
  EXPECT_EQ(a.next(from_a), Delivery::kEnd);
  EXPECT_EQ(a.next(from_a), Delivery::kEnd);
}

TEST(Simulator, FrameDependsOnItsNumberAlone) {
  SimulatorOptions options = small_options();
  options.scene.velocity_x = 0.1;
  add_preset("vortex", {}, options);
  Simulator in_order(options);
  Simulator at_once(options);
  FrameBuffer a(in_order.format());
  FrameBuffer b(at_once.format());
  for (int k = 0; k < 3; ++k) in_order.next(a);
  at_once.render(2, b);
  EXPECT_EQ(bytes_of(a, in_order.format()), bytes_of(b, at_once.format()));
  EXPECT_EQ(b.header.sequence, 2);
}

TEST(Simulator, WithoutEndHasNoCount) {
  SimulatorOptions options = small_options();
  options.frames = -7;
  Simulator simulator(options);
  FrameBuffer buffer(simulator.format());
  EXPECT_EQ(simulator.frame_count(), -1);
  for (int k = 0; k < 5; ++k) EXPECT_EQ(simulator.next(buffer), Delivery::kFrame);
}

// The optics' constants say what a pixel is worth: 2π over the pixels per λ/w.
TEST(Simulator, OpticsAgreeWithTheSpots) {
  SimulatorOptions options = small_options();
  options.samples_per_lambda_w = 2.5;
  options.scene.tilt_y_rad = 2.0 * 2.0 * kPi / 2.5;  // This is two pixels down.
  Simulator tilted(options);
  EXPECT_NEAR(tilted.optics().slope_rad_per_px(), 2.0 * kPi / 2.5, 1e-12);
  options.scene.tilt_y_rad = 0.0;
  Simulator flat(options);
  for (int i = 0; i < 6; ++i) {
    for (int j = 0; j < 8; ++j) {
      // The images are float, with 5000 electrons per lenslet.
      EXPECT_NEAR(tilted.expected_image_e()(8 + i + 2, 16 + j),
                  flat.expected_image_e()(8 + i, 16 + j), 1e-3);
    }
  }
  const LensletGrid grid = flat.grid();
  EXPECT_EQ(grid.pixel_from_lenslet(2, 1)[0], 3.5 + 16);
  EXPECT_EQ(grid.pixel_from_lenslet(2, 1)[1], 3.5 + 8);
  // The flat spot is symmetric about that place.
  EXPECT_NEAR(flat.expected_image_e()(8, 16), flat.expected_image_e()(15, 23), 1e-3);
}

TEST(Simulator, NeighboursGetWhatCroppingLoses) {
  SimulatorOptions options;
  options.rows = 9;  // The far field of 32 samples is 64 px wide, 4 windows to either side.
  options.cols = 9;
  options.photons = 1000.0;
  Simulator cropped(options);
  options.stray_light = StrayLight::kNeighbours;
  Simulator shared(options);
  // ±2 λ/w of sinc² hold .94994 of the light along each axis; 32 samples make it 6e-4 more.
  EXPECT_NEAR(light_in_window(cropped.expected_image_e(), 8, 4, 4) / 1000.0, 0.94994 * 0.94994,
              2e-3);
  // In the middle each window gets from the others what it loses to them, but for float rounding.
  EXPECT_NEAR(light_in_window(shared.expected_image_e(), 8, 4, 4), 1000.0, 1e-2);
}

TEST(Simulator, RoundAndObscuredPupils) {
  SimulatorOptions options;
  options.rows = 8;
  options.cols = 8;
  options.pupil = PupilShape::kRound;
  const Simulator round(options);
  // Centres lie at ±½, 1½, 2½, 3½: those within 4 pitches are all but 3 in every corner.
  int lit = 0;
  for (const auto value : round.lit()) lit += value;
  EXPECT_EQ(lit, 64 - 4 * 3);
  EXPECT_EQ(round.lit()(0, 0), 0);
  EXPECT_EQ(round.lit()(0, 2), 1);
  options.pupil = PupilShape::kObscured;
  options.obscuration = 0.3;  // 1.2 pitches take away the four in the middle.
  Simulator obscured(options);
  EXPECT_EQ(obscured.lit()(3, 3), 0);
  EXPECT_EQ(obscured.lit()(3, 2), 1);
  EXPECT_EQ(light_in_window(obscured.expected_image_e(), 8, 3, 4), 0.0);
  EXPECT_GT(light_in_window(obscured.expected_image_e(), 8, 3, 2), 4000.0);
}

// The mean and the variance of counts over many frames must be (signal + background)/g + bias and
// (signal + background + read noise²)/g² + 1/12 of rounding.
TEST(Simulator, NoiseHasItsMeanAndVariance) {
  SimulatorOptions options;
  options.rows = 1;
  options.cols = 1;
  options.photons = 400.0;
  options.background_e = 3.0;
  options.read_noise_e = 2.0;
  options.e_per_adu = 0.5;
  options.seed = 11;
  SCOPED_TRACE(::testing::Message() << "seed " << options.seed);
  Simulator simulator(options);
  FrameBuffer buffer(simulator.format());
  constexpr int kFrames = 20'000;
  std::vector<double> sum(64, 0.0);
  std::vector<double> squares(64, 0.0);
  for (int k = 0; k < kFrames; ++k) {
    simulator.render(k, buffer);
    for (std::size_t p = 0; p < 64; ++p) {
      const double value = buffer.view().data<std::uint16_t>()[p];
      sum[p] += value;
      squares[p] += value * value;
    }
  }
  for (std::size_t p = 0; p < 64; ++p) {
    const double electrons = static_cast<double>(simulator.expected_image_e()[p]);
    const double variance = (electrons + 4.0) / 0.25 + 1.0 / 12.0;
    const double mean = sum[p] / kFrames;
    // The bounds are 5 standard deviations; that of a variance is √(2/N) of it, here at most 10 %
    // more.
    EXPECT_NEAR(mean, 100.0 + electrons / 0.5, 5.0 * std::sqrt(variance / kFrames));
    EXPECT_NEAR(squares[p] / kFrames - mean * mean, variance,
                5.0 * 1.1 * variance * std::sqrt(2.0 / kFrames));
  }
}

TEST(Simulator, SaturationIsCutOffAndSaid) {
  SimulatorOptions options = small_options();
  options.bit_depth = 8;
  options.bias_adu = 10.0;
  options.photons = 1000.0;
  Simulator dim(options);
  FrameBuffer buffer(dim.format());
  EXPECT_EQ(dim.format().pixel_type, PixelType::kU8);
  dim.next(buffer);
  EXPECT_EQ(buffer.header.status, static_cast<std::uint32_t>(kFrameOk));
  options.photons = 1e5;
  options.saturation_adu = 200.0;
  Simulator bright(options);
  bright.next(buffer);
  EXPECT_EQ(buffer.header.status, static_cast<std::uint32_t>(kFrameSaturated));
  const auto* pixels = buffer.view().data<std::uint8_t>();
  EXPECT_EQ(*std::max_element(pixels, pixels + bright.format().pixels()), 200);
  EXPECT_EQ(bright.detector().saturation_adu, 200.0);
}

TEST(Simulator, NoiseFreeFramesAreAllAlike) {
  for (const double photons : {0.0, static_cast<double>(INFINITY)}) {
    SimulatorOptions options = small_options();
    options.photons = photons;
    options.background_e = 50.0;
    options.bit_depth = 16;
    Simulator simulator(options);
    FrameBuffer a(simulator.format());
    FrameBuffer b(simulator.format());
    simulator.render(0, a);
    simulator.render(1, b);
    EXPECT_EQ(bytes_of(a, simulator.format()), bytes_of(b, simulator.format()));
    const auto* pixels = a.view().data<std::uint16_t>();
    const int peak = *std::max_element(pixels, pixels + simulator.format().pixels());
    EXPECT_NEAR(peak, 100.0 + 0.75 * (65535.0 - 100.0), 1.0);  // This is rounding.
    EXPECT_EQ(simulator.detector().read_noise_e, 0.0);
  }
}

TEST(Simulator, TruthOfADipole) {
  SimulatorOptions options;
  PresetParameters parameters;
  parameters.x = 14.0;
  parameters.y = 3.0;
  parameters.separation = 1.25;
  add_preset("dipole", parameters, options);
  options.scene.velocity_x = 0.125;
  Simulator simulator(options);
  const std::vector<TruthVortex> first = simulator.truth(0);
  ASSERT_EQ(first.size(), 2U);
  EXPECT_EQ(first[0].x, 14.0);
  EXPECT_EQ(first[0].y, 3.0);
  EXPECT_EQ(first[0].charge, 1);
  EXPECT_EQ(first[0].separation, 1.25);
  EXPECT_EQ(first[1].x, 15.25);
  EXPECT_EQ(first[1].charge, -1);
  // Four frames later the negative one has left the array, and the other still knows its distance.
  const std::vector<TruthVortex> later = simulator.truth(4);
  ASSERT_EQ(later.size(), 1U);
  EXPECT_EQ(later[0].frame, 4);
  EXPECT_EQ(later[0].x, 14.5);
  EXPECT_EQ(later[0].separation, 1.25);
}

TEST(Simulator, LoneVortexIsInfinitelyFarFromOpposites) {
  SimulatorOptions options = small_options();
  PresetParameters parameters;
  parameters.charge = -1;
  add_preset("vortex", parameters, options);
  const std::vector<TruthVortex> truth = Simulator(options).truth(0);
  ASSERT_EQ(truth.size(), 1U);
  EXPECT_EQ(truth[0].x, 2.5);  // It is the node next to the middle of 6 columns and 4 rows.
  EXPECT_EQ(truth[0].y, 1.5);
  EXPECT_EQ(truth[0].charge, -1);
  EXPECT_TRUE(std::isinf(truth[0].separation));
}

TEST(Simulator, PresetsCombineAndUnknownOnesAreNamed) {
  SimulatorOptions options = small_options();
  for (const std::string& name : simulator_presets()) {
    if (name != "field" && name != "chen2007") add_preset(name, {}, options);
  }
  EXPECT_EQ(options.scene.vortices.size(), 3U);
  EXPECT_EQ(options.scene.zernikes.size(), 1U);
  EXPECT_EQ(options.scene.tilt_x_rad, 0.5);
  EXPECT_TRUE(options.turbulence.has_value());
  try {
    add_preset("vortx", {}, options);
    FAIL();
  } catch (const UsageError& error) {
    EXPECT_STREQ(error.what(),
                 "there is no preset 'vortx'; take one of plane, tilt, zernike, vortex, dipole, "
                 "field, turbulence, chen2007");
  }
  EXPECT_THROW(add_preset("field", {}, options), UsageError);
}

// A field that comes from a file must give the far field of the same scene computed, whatever unit
// the file is in, and its vortices must be the truth.
TEST(Simulator, FieldFromAFile) {
  SimulatorOptions computed = small_options();
  computed.field_samples = 16;
  add_preset("vortex", {}, computed);
  const ScratchDirectory scratch;
  const std::string path = scratch / "field.fits";
  const Beam beam(computed.scene, 4, 6, 16, 1.0);
  std::vector<float> planes(2UL * 4 * 6 * 16 * 16);
  Image<std::complex<double>> block(16, 16);
  for (int row = 0; row < 4; ++row) {
    for (int col = 0; col < 6; ++col) {
      beam.sample(row, col, 0, block);
      for (int i = 0; i < 16; ++i) {
        for (int j = 0; j < 16; ++j) {
          const auto k = static_cast<std::size_t>((row * 16 + i) * 96 + col * 16 + j);
          planes[k] = static_cast<float>(20.0 * block(i, j).real());
          planes[k + planes.size() / 2] = static_cast<float>(20.0 * block(i, j).imag());
        }
      }
    }
  }
  FitsFile file = FitsFile::create(path);
  file.create_image(ElementType::kF32, {2, 64, 96});
  file.write_pixels<float>(0, planes);
  file.commit();

  SimulatorOptions read = small_options();
  PresetParameters parameters;
  parameters.field_file = path;
  add_preset("field", parameters, read);
  Simulator from_file(read);
  Simulator from_scene(computed);
  for (std::size_t k = 0; k < from_file.expected_image_e().size(); ++k) {
    // Fields are float, which leaves 1e-7 of 1000 electrons per pixel, over 256 points.
    ASSERT_NEAR(from_file.expected_image_e()[k], from_scene.expected_image_e()[k], 1e-2);
  }
  const auto truth = from_file.truth(0);
  ASSERT_EQ(truth.size(), 1U);
  EXPECT_NEAR(truth[0].x, 2.5, 1e-6);  // By symmetry it is amid four samples.
  EXPECT_NEAR(truth[0].y, 1.5, 1e-6);
  EXPECT_EQ(truth[0].charge, 1);
}

TEST(Simulator, RefusesOptionsThatMakeNoSense) {
  const auto refused = [](auto change) {
    SimulatorOptions options = small_options();
    change(options);
    EXPECT_THROW(Simulator{options}, UsageError);
  };
  refused([](auto& o) { o.rows = 0; });
  refused([](auto& o) { o.cols = 1 << 30; });
  refused([](auto& o) { o.window_px = 0; });
  refused([](auto& o) { o.window_px = 100; });  // It is wider than 32 field samples can hold.
  refused([](auto& o) { o.samples_per_lambda_w = 0.0; });
  refused([](auto& o) { o.field_samples = 1; });
  refused([](auto& o) { o.photons = -1.0; });
  refused([](auto& o) { o.photons = NAN; });
  refused([](auto& o) { o.background_e = -1.0; });
  refused([](auto& o) { o.read_noise_e = NAN; });
  refused([](auto& o) { o.e_per_adu = 0.0; });
  refused([](auto& o) { o.bit_depth = 9; });
  refused([](auto& o) { o.saturation_adu = 5000.0; });
  refused([](auto& o) { o.bias_adu = 4095.0; });
  refused([](auto& o) { o.obscuration = 1.0, o.pupil = PupilShape::kObscured; });
}

}  // namespace
}  // namespace curlew
