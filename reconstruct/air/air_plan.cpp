#include "reconstruct/air/air_plan.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

namespace curlew {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kKolmogorov = 0.0229;
constexpr int kLastNoll = 36;

double sinc(double x) { return std::abs(x) < 1e-8 ? 1.0 : std::sin(kPi * x) / (kPi * x); }

/// Mean gradient over a lenslet: what a wave exp(2πi f·r) loses of its gradient.
double lenslet_filter(double fx, double fy) { return sinc(fx) * sinc(fy); }

/// Returns how many steps of ln f lie between exp(lowest) and highest.
int steps_to(double highest, double lowest, double step) {
  return static_cast<int>(std::ceil((std::log(highest) - lowest) / step));
}

}  // namespace

AirPlan::AirPlan(const Image<std::uint8_t>& lit, const AirOptions& options)
    : lit_(lit),
      modes_(lit, kLastNoll),
      fresnel_(options.fresnel_pitches),
      separation_(std::max(1, std::min(lit.rows(), lit.cols()) / 4)) {
  find_pair_variance();
  find_mode_variance();
}

/// Returns the spectrum of phase for r0 = 1, rad² per (cycle/pitch)². In even air along a path of
/// length L diffraction turns phase into scintillation, which leaves the mean of cos²(πλz f²) over
/// z of its power (V. I. Tatarskii, Wave Propagation in a Turbulent Medium, 1961).
double AirPlan::spectrum(double f) const {
  const double turn = 2.0 * kPi * fresnel_ * fresnel_ * f * f;
  const double left = turn < 1e-6 ? 1.0 : 0.5 * (1.0 + std::sin(turn) / turn);
  return kKolmogorov * std::pow(f, -11.0 / 3.0) * left;
}

// ½⟨(s(r + Δ) − s(r))²⟩ = ∫ (2πf)²/2 · spectrum · filter² · (1 − cos 2πf·Δ) d²f for the mean of
// both components; by symmetry one Δ is enough, and a quarter of all directions.
void AirPlan::find_pair_variance() {
  constexpr int kAngles = 96;
  constexpr double kStep = 0.01;  // of ln f
  constexpr double kHighest = 10.0;
  const double lowest = std::log(1e-3 / separation_);
  const int steps = steps_to(kHighest, lowest, kStep);
  for (int step = 0; step < steps; ++step) {
    const double f = std::exp(lowest + step * kStep);
    double sum = 0.0;
    for (int i = 0; i < kAngles; ++i) {
      const double angle = 0.5 * kPi * (i + 0.5) / kAngles;
      const double fx = f * std::cos(angle);
      const double filter = lenslet_filter(fx, f * std::sin(angle));
      sum += filter * filter * (1.0 - std::cos(2.0 * kPi * fx * separation_));
    }
    pair_variance_ += 2.0 * kPi * kPi * f * f * spectrum(f) * (sum / kAngles) * 2.0 * kPi * f * f *
                      kStep;  // d²f = 2πf df, df = f·d(ln f)
  }
}

// A fitted coefficient is Σ R·s over the lenslets, so its variance is the integral over the
// spectrum of |Σ R·2πi f·filter·exp(2πi f·r)|².
void AirPlan::find_mode_variance() {
  constexpr int kOrdersLast = 9;  // Noll 10 is mode 8
  const int count = std::max(0, std::min(modes_.modes(), kOrdersLast) - kFirstMode);
  mode_variance_ = Eigen::VectorXd::Zero(count);
  if (count == 0) return;
  const ModeResponse response = modes_.response();
  constexpr int kAngles = 36;
  constexpr double kStep = 0.08;
  constexpr double kHighest = 2.0;
  constexpr double kGolden = 0.6180339887498949;
  double turn = 0.0;  // each frequency has angles of its own, so that none is left out by all
  Eigen::VectorXcd sum(count);
  const double lowest = std::log(0.02 / modes_.pupil().radius);
  const int steps = steps_to(kHighest, lowest, kStep);
  for (int step = 0; step < steps; ++step) {
    const double f = std::exp(lowest + step * kStep);
    turn = std::fmod(turn + kGolden, 1.0);
    for (int i = 0; i < kAngles; ++i) {
      const double angle = kPi * (i + turn) / kAngles;  // −f has the same power
      const double fx = f * std::cos(angle);
      const double fy = f * std::sin(angle);
      sum.setZero();
      for (std::size_t k = 0; k < response.lenslets.size(); ++k) {
        const auto index = static_cast<int>(response.lenslets[k]);
        const int row = index / lit_.cols(), col = index % lit_.cols();
        const double phase = 2.0 * kPi * (fx * col + fy * row);
        const std::complex<double> wave(std::cos(phase), std::sin(phase));
        const auto column = static_cast<Eigen::Index>(k);
        sum +=
            wave *
            (fx * response.x.col(column) + fy * response.y.col(column)).segment(kFirstMode, count);
      }
      const double filter = 2.0 * kPi * lenslet_filter(fx, fy);
      mode_variance_ +=
          filter * filter * spectrum(f) * (2.0 * kPi / kAngles) * f * f * kStep * sum.cwiseAbs2();
    }
  }
}

}  // namespace curlew
