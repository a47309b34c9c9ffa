// Finds the spots of a frame anew, wherever they are: at the start, and after light was lost.
#pragma once

#include <array>
#include <complex>
#include <cstdint>
#include <vector>

#include "centroiding/centroid.h"
#include "centroiding/frame_level.h"
#include "centroiding/low_orders.h"
#include "centroiding/sensor.h"
#include "centroiding/sharp_pixels.h"
#include "core/frame.h"
#include "core/image.h"
#include "core/lenslet_grid.h"

namespace curlew {

/// What is known of the frames before the one in which spots are sought.
struct SpotHistory {
  const Image<std::uint8_t>& lit;  ///< [rows, cols] 1 where a lenslet had its spot
  std::array<float, 2> mean_px{};  ///< mean displacement of its spots, from lit lenslets
};

enum class AcquisitionResult : std::uint8_t {
  kFound,
  kNoLight,      ///< too few cells hold light
  kNoGrid,       ///< the light does not lie on the lenslets' lattice
  kUndecidable,  ///< the spots could lie half a pitch this way or that
};

/// Finds the low orders of the spots' displacements in one frame, without windows.
///
/// For each cell of the lattice, Σ I·exp(−2πi u) and Σ I·exp(−2πi v) are taken over a pitch, where
/// (u, v) are lattice coordinates. Their phases say where the spot lies within the cell, and a spot
/// on the border of two cells says the same to both. Phases of neighbours' products give scale and
/// rotation up to half a pitch from lenslet to lenslet; then come the shift and a quadratic fit.
/// Whole pitches are chosen so that as many as possible of the lenslets that were lit are lit. What
/// that does not decide, the smallest step from where the spots were decides; where two steps are
/// about equally small, nothing does.
class SpotAcquisition {
 public:
  SpotAcquisition(const Sensor& sensor, const CentroidPlan& plan);

  /// The frame must be of the plan's format, and `levels` and `sharp` must be known. `model` gets
  /// displacements in px. Never allocates.
  AcquisitionResult find(const CentroidPlan& plan, FrameView frame,
                         const FrameConditions& conditions, const SpotHistory& history,
                         LowOrders& model) noexcept;

 private:
  static constexpr int kMargin = 3;  ///< cells round the array, and pitches that are tried
  using Complex = std::complex<float>;
  struct Cell {
    float light = 0;  ///< counts
    Complex u;        ///< Σ I·exp(−2πi u)
    Complex v;
    bool lit = false;
  };
  struct Place {
    float u = 0;
    float v = 0;
  };
  /// Factors of exp(−2πi u) and exp(−2πi v) along a frame's axis.
  struct Waves {
    std::vector<Complex> u;
    std::vector<Complex> v;
  };

  /// Gives a pixel's light above its level, in counts, and at least 0.
  template <typename Pixel>
  struct Light {
    const CentroidPlan& plan;
    const Pixel* pixels;
    const FrameLevels& levels;
    float raised_of(int row, int col) const noexcept;
    float at(std::size_t i, float count, float raised) const noexcept;
  };
  template <typename Pixel>
  float sum_light(const Light<Pixel>& light, int row, int col, double x_px, double y_px,
                  Cell* moments) const noexcept;
  template <typename Pixel>
  void replace_sharp_pixels(const Light<Pixel>& light, const SharpPixels& sharp) noexcept;
  template <typename Pixel>
  AcquisitionResult find_in(const Light<Pixel>& light, const SharpPixels& sharp,
                            const SpotHistory& history, LowOrders& model) noexcept;
  bool mark_lit(float threshold) noexcept;
  bool fit_lattice() noexcept;
  bool fit_quadratic() noexcept;
  AcquisitionResult choose_pitches(const SpotHistory& history, LowOrders& model) const noexcept;
  Place fraction(int row, int col) const noexcept;

  LensletGrid grid_;
  int side_;
  Waves along_x_;
  Waves along_y_;
  Image<Cell> cells_;         ///< [rows + 2·kMargin, cols + 2·kMargin]
  Image<std::uint8_t> spot_;  ///< whether the spot that the model places by each node is there
  std::vector<float> buffer_;
  LowOrders phase_;  ///< the model in pitches, up to whole ones
};

}  // namespace curlew
