// This is the simulated beam: a scene, and its complex field over every lenslet.
#pragma once

#include <complex>
#include <cstdint>
#include <string>
#include <vector>

#include "core/image.h"
#include "core/zernike.h"

namespace curlew {

/// Says what the amplitude is round a simulated vortex.
enum class VortexAmplitude {
  kUniform,     ///< 1 everywhere, as in the paper: the phase alone is singular
  kLinearCore,  ///< min(|u|/core radius, 1), u the vortex factor: exactly linear inside the core
};

/// Describes a vortex: φ = Im ln u with u = ξ(x+iy) + ζ(x−iy) and x, y measured from its centre,
/// where ξ = cos(α/2)·e^{iβ/2} and ζ = sin(α/2)·e^{−iβ/2}. Charge −1 is the conjugate field.
struct SceneVortex {
  double x = 0.0;          ///< lenslet units
  double y = 0.0;          ///< lenslet units
  int charge = 1;          ///< +1 or −1; positive where the phase grows from +x to +y
  double alpha_rad = 0.0;  ///< morphology α in [0, π/2), 0 the canonical vortex
  double beta_rad = 0.0;   ///< morphology β
};

struct SceneZernike {
  int noll = 4;          ///< Noll's index j
  double rms_rad = 0.0;  ///< root mean square over the normalising disc
};

/// Says what the beam looks like at the lenslets: amplitude 1 × Π vortex factors × exp(i·phase).
struct Scene {
  std::vector<SceneVortex> vortices;  ///< empty if there are none
  VortexAmplitude vortex_amplitude = VortexAmplitude::kUniform;
  /// Radius at which a linear core's amplitude reaches 1, pitches. The linear range must cover the
  /// lenslets round the vortex; the smaller it is, the more light falls on them.
  double core_radius = 4.0;
  double tilt_x_rad = 0.0;             ///< phase slope along x, rad per pitch
  double tilt_y_rad = 0.0;             ///< phase slope along y, rad per pitch
  std::vector<SceneZernike> zernikes;  ///< added to the phase
  std::string field_file;              ///< FITS file of a complex field that multiplies all
  double velocity_x = 0.0;  ///< velocity of this scene's vortices along x, pitches per frame
  double velocity_y = 0.0;  ///< their velocity along y, pitches per frame
};

inline constexpr int kMaxFieldSamples = 1024;  ///< points per lenslet side

/// Holds a sampled complex field. Point (i, j) lies at ((j+½)/n − ½ − m, (i+½)/n − ½ − m) in
/// lenslet units, with n samples per lenslet and m lenslets of margin.
struct SampledField {
  Image<std::complex<float>> values;  ///< [(rows+2m)·n, (cols+2m)·n]; empty if none
  int samples_per_lenslet = 0;
  int margin_lenslets = 0;  ///< lenslets known beyond the array on each side
};

/// Evaluates a scene's field, lenslet by lenslet.
class Beam {
 public:
  /// rows, cols: number of lenslets. samples: points per lenslet side. disc_radius: radius, in
  /// pitches, of the disc, centred on the array, over which Zernike polynomials are normalised.
  /// field: empty, or sampled with `samples` points per lenslet. Throws UsageError for a scene that
  /// makes no sense.
  Beam(const Scene& scene, int rows, int cols, int samples, double disc_radius,
       SampledField field = {});

  /// Takes another sampled field, which must have as many points per lenslet.
  void set_field(SampledField field);

  /// Returns the vortices of the scene at a frame, then those of the sampled field (which do not
  /// move), its margin included.
  std::vector<SceneVortex> vortices(std::int64_t frame) const;

  /// Fills `field` [samples, samples] with lenslet (row, col)'s field in that frame.
  void sample(int row, int col, std::int64_t frame, Image<std::complex<double>>& field) const;

  bool moves() const { return moves_; }  ///< whether the scene's own vortices move

 private:
  struct Factor {  // a vortex ready for evaluation: u = ξ(x+iy) + ζ(x−iy)
    double x;
    double y;
    std::complex<double> xi;
    std::complex<double> zeta;
    int charge;
  };
  struct Mode {
    Zernike zernike;
    double rms_rad;
  };

  Scene scene_;
  int rows_;
  int cols_;
  int samples_;
  double disc_radius_;
  SampledField field_;
  bool moves_;
  std::vector<Factor> factors_;
  std::vector<Mode> modes_;
  std::vector<SceneVortex> field_vortices_;
};

}  // namespace curlew
