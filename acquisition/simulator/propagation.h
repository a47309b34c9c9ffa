// A Propagation takes a beam through turbulence to the lenslets, by split steps.
#pragma once

#include <Eigen/Core>
#include <complex>
#include <cstdint>
#include <unsupported/Eigen/FFT>

#include "acquisition/simulator/field.h"
#include "acquisition/simulator/phase_screen.h"
#include "acquisition/simulator/square_fft.h"
#include "acquisition/simulator/turbulent_path.h"
#include "core/image.h"

namespace curlew {

/// Takes a plane wave or a collimated Gaussian beam over a TurbulentPath: there is a phase screen
/// in the middle of each slab, and a paraxial angular spectrum between them (J. M. Martin and S. M.
/// Flatté, Appl. Opt. 27, 2111, 1988). A plane wave's grid is periodic and loses nothing. A beam's
/// screens have subharmonics, and an absorbing guard near the grid's edge takes what would come
/// round.
///
/// The field comes out on a grid finer by a whole factor. This is exact, because what reaches the
/// lenslets has no frequency beyond the grid's.
class Propagation {
 public:
  /// rows, cols: number of lenslets. min_samples: field points wanted per lenslet side. Throws
  /// UsageError as choose_grid does.
  Propagation(const TurbulentPath& path, int rows, int cols, int min_samples, std::uint64_t seed);

  const PropagationGrid& grid() const { return grid_; }
  /// Returns the points per lenslet side of the field that comes out.
  int field_samples() const { return grid_.samples_per_lenslet * grid_.finer; }

  /// Computes the field of a frame at the lenslets, with grid().margin more lenslets on each side.
  /// A plane wave has mean |field|² 1 over the whole grid; a beam would have it over the array in
  /// vacuum. The same seed and frame give the same field, whichever frames were asked for before.
  void propagate(std::int64_t frame, SampledField& field);

 private:
  void set_start();
  void pass_screen(bool second);
  void step();
  void deliver(SampledField& field);

  // Says how the field comes out along one axis. By frequency, the factors are those of the last
  // stretch of free space and of the shift of half a point against half a fine one. `first` and
  // `points` say which fine points are delivered.
  struct OutAxis {
    Eigen::ArrayXcf factors;
    int first = 0;
    int points = 0;
  };
  OutAxis make_out_axis(int lenslets) const;
  void make_finer(const OutAxis& axis, const std::complex<float>* spectrum,
                  std::complex<float>* out);

  TurbulentPath path_;
  int rows_;
  int cols_;
  PropagationGrid grid_;
  PhaseScreens screens_;
  SquareFft fft_;
  Image<std::complex<float>> start_;  // field before the first screen; empty for a plane wave
  Image<std::complex<float>> field_;
  Image<std::complex<float>> pair_;  // the two screens at hand, rad
  Eigen::ArrayXcf step_;  // free space from screen to screen, by frequency along one axis
  Eigen::ArrayXf guard_;  // guard along one axis; empty if there is none
  OutAxis out_x_;
  OutAxis out_y_;
  Eigen::FFT<float> fine_fft_;
  Eigen::ArrayXcf fine_spectrum_;
  Eigen::ArrayXcf fine_line_;
  Image<std::complex<float>> out_by_frequency_;  // [frequency along x, y]
  Image<std::complex<float>> out_by_row_;        // [y, frequency along x]
};

}  // namespace curlew
