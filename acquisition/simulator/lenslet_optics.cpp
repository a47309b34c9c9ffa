#include "acquisition/simulator/lenslet_optics.h"

#include <cmath>
#include <numbers>
#include <sstream>

#include "core/error.h"

namespace curlew {
namespace {

double sinc(double x) {
  const double angle = std::numbers::pi * x;
  return std::abs(angle) < 1e-8 ? 1.0 : std::sin(angle) / angle;
}

}  // namespace

// Returns B with pixel = B·intensity along one axis. The intensity I(u) = Σ_d R_d exp(−2πi u d/n)
// has lags |d| < n only, and R_d follows from its samples at u = k/2, k = 0 … 2n−1. A pixel of
// width h round u_j multiplies lag d by h·sinc(h d/n). The scale makes all pixels together the
// power.
Eigen::MatrixXd integrate_pixels(int samples, double pixels_per_lambda_w, int patch_px) {
  const double n = samples;
  const double width = 1.0 / pixels_per_lambda_w;  // λ/w
  Eigen::MatrixXd result(patch_px, 2 * samples);
  for (int j = 0; j < patch_px; ++j) {
    const double u = (j - 0.5 * (patch_px - 1)) * width;
    for (int k = 0; k < 2 * samples; ++k) {
      double sum = 1.0;
      for (int d = 1; d < samples; ++d) {
        sum += 2.0 * sinc(width * d / n) * std::cos(2.0 * std::numbers::pi * d * (0.5 * k - u) / n);
      }
      result(j, k) = sum * width / (2.0 * n) / (n * n);
    }
  }
  return result;
}

LensletOptics::LensletOptics(int samples, double pixels_per_lambda_w, int patch_px)
    : samples_(samples), patch_px_(patch_px) {
  if (samples < 2 || patch_px < 1 || !(pixels_per_lambda_w > 0.0)) {
    throw UsageError(
        "the simulator needs at least 2 field samples a lenslet, a window of 1 pixel and more than "
        "0 pixels per lambda/w; give larger ones");
  }
  const double patch_width = patch_px / pixels_per_lambda_w;  // λ/w
  if (patch_width > samples * (1.0 + 1e-9)) {
    std::ostringstream message;
    message << "a far field " << patch_width << " lambda/w wide needs as many field samples a "
            << "lenslet and there are " << samples
            << "; raise the field samples, or the samples per lambda/w, or narrow the window";
    throw UsageError(message.str());
  }
  const int padded = 2 * samples;
  line_ = Eigen::VectorXcd::Zero(padded);
  spectrum_ = Eigen::VectorXcd::Zero(padded);
  half_transformed_.resize(samples, padded);
  intensity_.resize(padded, padded);
  pixels_from_intensity_ = integrate_pixels(samples, pixels_per_lambda_w, patch_px);
}

void LensletOptics::propagate(const Image<std::complex<double>>& field, Image<double>& patch) {
  const int padded = 2 * samples_;
  line_.setZero();
  for (int i = 0; i < samples_; ++i) {
    for (int j = 0; j < samples_; ++j) line_(j) = field(i, j);
    fft_.fwd(spectrum_.data(), line_.data(), padded);
    half_transformed_.row(i) = spectrum_.transpose();
  }
  for (int k = 0; k < padded; ++k) {
    line_.head(samples_) = half_transformed_.col(k);
    fft_.fwd(spectrum_.data(), line_.data(), padded);
    intensity_.col(k) = spectrum_.cwiseAbs2();
  }
  patch_.noalias() =
      pixels_from_intensity_ * (intensity_ * pixels_from_intensity_.transpose()).eval();
  for (int i = 0; i < patch_px_; ++i) {
    for (int j = 0; j < patch_px_; ++j) patch(i, j) = patch_(i, j);
  }
}

}  // namespace curlew
