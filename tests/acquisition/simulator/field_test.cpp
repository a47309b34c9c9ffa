#include "acquisition/simulator/field.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>
#include <string>
#include <vector>

#include "acquisition/fits/fits_file.h"
#include "acquisition/simulator/field_file.h"
#include "core/error.h"
#include "tests/support/constants.h"
#include "tests/support/scratch_directory.h"

namespace curlew {
namespace {

using Complex = std::complex<double>;

Image<Complex> sample(const Scene& scene, int rows, int cols, int samples, int row, int col,
                      std::int64_t frame = 0) {
  Image<Complex> field(samples, samples);
  Beam(scene, rows, cols, samples, 0.5 * std::hypot(rows, cols)).sample(row, col, frame, field);
  return field;
}

Scene scene_with(const SceneVortex& vortex) {
  Scene scene;
  scene.vortices.push_back(vortex);
  return scene;
}

// Returns the phase gained on the way (0,0) → (0,1) → (1,1) → (1,0) of samples, which is from +x
// towards +y. In this sense the phase grows round a positive charge (docs/conventions.md).
double turn(const Image<Complex>& f) {
  const Complex corner[] = {f(0, 0), f(0, 1), f(1, 1), f(1, 0)};
  double sum = 0.0;
  for (int c = 0; c < 4; ++c) sum += std::arg(corner[(c + 1) % 4] * std::conj(corner[c]));
  return sum;
}

TEST(Beam, PhaseOfAPositiveVortexGrowsFromXToY) {
  for (const int charge : {1, -1}) {
    for (const double alpha : {0.0, 0.7, 1.4}) {
      const SceneVortex vortex{
          .x = 0.02, .y = -0.03, .charge = charge, .alpha_rad = alpha, .beta_rad = 2.0};
      EXPECT_NEAR(turn(sample(scene_with(vortex), 1, 1, 2, 0, 0)), 2.0 * kPi * charge, 1e-12);
    }
  }
}

// φ = Im ln[ξ(x+iy) + ζ(x−iy)] has the gradient (x ŷ − y x̂)·cosα / Q (the paper's Eqs. 17–20).
TEST(Beam, VortexPhaseHasItsGradient) {
  const double alpha = 0.8;
  const double beta = 2.1;
  const SceneVortex vortex{.x = -1.0, .y = -2.0, .charge = 1, .alpha_rad = alpha, .beta_rad = beta};
  constexpr int kSamples = 1000;
  const Image<Complex> f = sample(scene_with(vortex), 1, 1, kSamples, 0, 0);
  // Sample 500 of 1000 lies half a sample beyond the lenslet's centre.
  const double x = 1.0 + 0.5 / kSamples;
  const double y = 2.0 + 0.5 / kSamples;
  const double a = std::sin(alpha) * std::cos(beta);
  const double q =
      (1.0 + a) * x * x - 2.0 * std::sin(alpha) * std::sin(beta) * x * y + (1.0 - a) * y * y;
  const int i = 500;
  const double dx = std::arg(f(i, i + 1) * std::conj(f(i, i - 1))) * kSamples / 2.0;
  const double dy = std::arg(f(i + 1, i) * std::conj(f(i - 1, i))) * kSamples / 2.0;
  // Central differences over 2e-3 pitches are right to 1e-6.
  EXPECT_NEAR(dx, -y * std::cos(alpha) / q, 1e-5);
  EXPECT_NEAR(dy, x * std::cos(alpha) / q, 1e-5);
}

TEST(Beam, AmplitudeIsUniformOrLinearToTheCoreRadius) {
  Scene scene = scene_with({.x = 0.0, .y = 0.0, .charge = -1});
  for (const auto& value : sample(scene, 1, 3, 8, 0, 2)) EXPECT_NEAR(std::abs(value), 1.0, 1e-14);

  scene.vortex_amplitude = VortexAmplitude::kLinearCore;
  scene.core_radius = 2.0;
  const Image<Complex> f = sample(scene, 1, 3, 8, 0, 2);
  for (int i = 0; i < 8; ++i) {
    for (int j = 0; j < 8; ++j) {
      const double r = std::hypot(2.0 + (j + 0.5) / 8.0 - 0.5, (i + 0.5) / 8.0 - 0.5);
      EXPECT_NEAR(std::abs(f(i, j)), std::min(r / 2.0, 1.0), 1e-14);
    }
  }
}

// The tilt is in rad per pitch, and Zernike 2 of rms a over a disc of radius R is 2ax/R.
TEST(Beam, TiltAndZernikeAddUp) {
  Scene scene;
  scene.tilt_x_rad = 0.3;
  scene.tilt_y_rad = -0.2;
  scene.zernikes.push_back({2, 0.5});
  const Image<Complex> f = sample(scene, 4, 4, 8, 1, 2);
  const double along_x = std::arg(f(3, 7) * std::conj(f(3, 0))) * 8.0 / 7.0;
  const double along_y = std::arg(f(7, 3) * std::conj(f(0, 3))) * 8.0 / 7.0;
  EXPECT_NEAR(along_x, 0.3 + 2.0 * 0.5 / std::sqrt(8.0), 1e-12);
  EXPECT_NEAR(along_y, -0.2, 1e-12);
}

TEST(Beam, VorticesMoveWithTheirVelocity) {
  Scene scene = scene_with({.x = 1.0, .y = 2.0});
  scene.velocity_x = 0.25;
  scene.velocity_y = -0.5;
  const Scene later = scene_with({.x = 2.0, .y = 0.0});
  const Image<Complex> moved = sample(scene, 4, 4, 8, 1, 1, 4);
  const Image<Complex> fixed = sample(later, 4, 4, 8, 1, 1);
  for (std::size_t k = 0; k < moved.size(); ++k) EXPECT_LT(std::abs(moved[k] - fixed[k]), 1e-14);
}

TEST(Beam, RefusesScenesThatMakeNoSense) {
  EXPECT_THROW(Beam(scene_with({.charge = 0}), 4, 4, 8, 2.0), UsageError);
  EXPECT_THROW(Beam(scene_with({.charge = 2}), 4, 4, 8, 2.0), UsageError);
  EXPECT_THROW(Beam(scene_with({.alpha_rad = 1.6}), 4, 4, 8, 2.0), UsageError);
  EXPECT_THROW(Beam(scene_with({.x = std::nan("")}), 4, 4, 8, 2.0), UsageError);
  Scene scene;
  scene.zernikes.push_back({0, 1.0});
  EXPECT_THROW(Beam(scene, 4, 4, 8, 2.0), UsageError);
  scene = {};
  scene.tilt_x_rad = INFINITY;
  EXPECT_THROW(Beam(scene, 4, 4, 8, 2.0), UsageError);
}

// Makes a field with two vortices of linear amplitude.
SampledField make_field(int rows, int cols, int n) {
  SampledField field{Image<std::complex<float>>(rows * n, cols * n), n};
  for (int i = 0; i < rows * n; ++i) {
    for (int j = 0; j < cols * n; ++j) {
      const double x = (j + 0.5) / n - 0.5;
      const double y = (i + 0.5) / n - 0.5;
      field.values(i, j) =
          std::complex<float>(Complex(x - 1.23, y - 0.41) * std::conj(Complex(x - 2.5, y - 2.6)));
    }
  }
  return field;
}

void write_field(const std::string& path, const SampledField& field, std::int64_t planes = 2) {
  FitsFile file = FitsFile::create(path);
  const auto points = static_cast<std::int64_t>(field.values.size());
  file.create_image(ElementType::kF32, {planes, field.values.rows(), field.values.cols()});
  std::vector<float> part;
  for (const auto& value : field.values) part.push_back(value.real());
  file.write_pixels<float>(0, part);
  part.clear();
  for (const auto& value : field.values) part.push_back(value.imag());
  if (planes > 1) file.write_pixels<float>(points, part);
  file.commit();
}

TEST(SampledField, ComesBackFromItsFile) {
  const ScratchDirectory scratch;
  const std::string path = scratch / "field.fits";
  const SampledField written = make_field(3, 5, 8);
  write_field(path, written);
  const SampledField read = read_sampled_field(path, 3, 5);
  EXPECT_EQ(read.samples_per_lenslet, 8);
  ASSERT_EQ(read.values.size(), written.values.size());
  for (std::size_t k = 0; k < read.values.size(); ++k) {
    ASSERT_EQ(read.values[k], written.values[k]);
  }
}

TEST(SampledField, ThatDoesNotFitIsRefused) {
  const ScratchDirectory scratch;
  const std::string path = scratch / "field.fits";
  write_field(path, make_field(4, 4, 8));
  EXPECT_THROW(read_sampled_field(path, 4, 5), Failure);
  EXPECT_THROW(read_sampled_field(path, 3, 4), Failure);
  EXPECT_THROW(read_sampled_field(path, 32, 32), Failure);  // This would be one sample per lenslet.
  write_field(path, make_field(4, 4, 8), 1);
  EXPECT_THROW(read_sampled_field(path, 4, 4), Failure);
  SampledField hole = make_field(4, 4, 8);
  hole.values[7] = NAN;
  write_field(path, hole);
  EXPECT_THROW(read_sampled_field(path, 4, 4), Failure);
  EXPECT_THROW(read_sampled_field(scratch / "missing.fits", 4, 4), Failure);
}

}  // namespace
}  // namespace curlew
