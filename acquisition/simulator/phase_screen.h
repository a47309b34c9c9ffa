// This draws von Kármán phase screens.
#pragma once

#include <Eigen/Core>
#include <complex>
#include <cstdint>
#include <vector>

#include "acquisition/simulator/random_stream.h"
#include "acquisition/simulator/square_fft.h"
#include "core/image.h"

namespace curlew {

/// Gives the power spectrum of a phase with modified von Kármán statistics, in any one unit of
/// length: .0229 r0^(−5/3) (f² + 1/L0²)^(−11/6) exp(−(2π f l0/5.92)²), rad² per (cycle/length)².
/// .0229 in full is (24/5 Γ(6/5))^(5/6) Γ(11/6)²/(2π^(11/3)), so that without scales the structure
/// function is 6.88 (r/r0)^(5/3) (D. L. Fried, J. Opt. Soc. Am. 56, 1372, 1966).
struct VonKarman {
  double r0 = 1.0;           ///< Fried's parameter; infinite without turbulence
  double outer_scale = 0.0;  ///< L0; may be infinite
  double inner_scale = 0.0;  ///< l0; may be 0

  double operator()(double frequency) const;
};

/// Says by how much a screen has drifted, in the unit of length of its spacing.
struct ScreenShift {
  double x = 0.0;
  double y = 0.0;
};

/// Draws screens of n × n points, two at a time: they are the real and the imaginary part of one
/// transform.
///
/// They are periodic unless they have subharmonics, which add what is slower than the grid's width,
/// in 3×3 squares of ever lower frequencies (R. G. Lane, A. Glindemann and J. C. Dainty, Waves
/// Random Media 2, 209, 1992). Each frequency has random numbers of its own: a grid of the same
/// width with more points draws the same screen with more detail. The mean (piston) is left out.
class PhaseScreens {
 public:
  /// n: points per side, an even number. subharmonics: whether to add them.
  PhaseScreens(int n, double spacing, const VonKarman& spectrum, bool subharmonics,
               std::uint64_t seed);

  /// Fills `screens` [n, n], rad, with pair `pair` of that realisation: one screen is the real part
  /// and the next is the imaginary part, each drifted by its shift (what was at x is at x + shift).
  /// The same seed, realisation and pair give the same screens.
  void draw(std::int64_t realisation, int pair, const ScreenShift& first, const ScreenShift& second,
            SquareFft& fft, Image<std::complex<float>>& screens);

  /// Returns the variance that a screen has on average, subharmonics included, rad².
  double expected_variance() const;
  /// Returns a screen's structure function at (x, y) on average, rad²: that of the discrete
  /// frequencies.
  double expected_structure(double x, double y) const;

 private:
  struct Slow {  // a subharmonic
    double fx, fy;
    double power;  // rad²
    int level;
  };

  void drift(const ScreenShift& first, const ScreenShift& second,
             Image<std::complex<float>>& spectrum) const;
  void add_subharmonics(RandomStream& random, const ScreenShift& shift, bool imaginary,
                        Image<std::complex<float>>& screens);

  int n_;
  double spacing_;
  std::uint64_t seed_;
  Image<float> amplitude_;  // [n/2, n/2] by |frequency| along each axis
  std::vector<Slow> slow_;
  int levels_ = 0;
  Eigen::MatrixXf along_x_;  // [3·levels, n] of one screen
  Eigen::MatrixXf along_y_;  // [n, 3·levels]: 1, cos, sin
  Eigen::RowVectorXf line_;
};

}  // namespace curlew
