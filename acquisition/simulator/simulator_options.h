// SimulatorOptions: what to simulate, and the named presets.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "acquisition/simulator/field.h"
#include "acquisition/simulator/turbulent_path.h"
#include "core/image.h"
#include "core/optics.h"

namespace curlew {

enum class PupilShape {
  kSquare,    ///< every lenslet is lit
  kRound,     ///< lit where its centre is within the largest circle on the array
  kObscured,  ///< as round, less those whose centre is within a central disc
};

/// Where light goes that falls beyond its lenslet's window.
enum class StrayLight {
  kCropped,     ///< it is lost
  kNeighbours,  ///< it falls on the pixels of the lenslets around; their intensities add
};

struct SimulatorOptions {
  int rows = 16;                      ///< lenslets
  int cols = 16;                      ///< lenslets
  int window_px = 8;                  ///< pixels per lenslet side: the pitch on the detector
  double samples_per_lambda_w = 2.0;  ///< pixels per λ/w in the focus: 2 is a pixel of .5 λ/w
  int field_samples =
      32;  ///< field points per lenslet side; field file and turbulence bring theirs
  PupilShape pupil = PupilShape::kSquare;
  double obscuration = 0.3;  ///< central disc's diameter over the circle's, in [0, 1)
  StrayLight stray_light = StrayLight::kCropped;

  /// Mean photo-electrons a lit lenslet gathers, over its whole far field, where the amplitude
  /// is 1. 0 or infinity: frames without any noise or background, scaled so that the brightest
  /// pixel of frame 0 (behind turbulence: of each) lies three quarters of the way from bias to
  /// saturation.
  double photons = 5000.0;
  double background_e = 0.0;    ///< mean background per pixel, electrons, with its photon noise
  double read_noise_e = 1.0;    ///< Gaussian, rms electrons per pixel
  double e_per_adu = 1.0;       ///< electrons a count stands for
  double bias_adu = 100.0;      ///< added to every pixel (use 10 or less with 8 bits)
  double saturation_adu = 0.0;  ///< pixels are cut off here; 0: where the bits end
  int bit_depth = 12;           ///< 8 gives u8 frames, 10 to 16 give u16

  std::int64_t frames = 1;  ///< how many there are; negative: without end
  std::uint64_t seed = 1;   ///< of noise and turbulence; frame k depends on seed and k alone
  Scene scene;              ///< the beam; the default is a plane wave
  /// What the beam comes through before the scene multiplies it; none: nothing.
  std::optional<TurbulentPath> turbulence;
};

/// What the named presets are made from; each reads only its own.
struct PresetParameters {
  double x = kUnknown;      ///< `vortex`, `dipole` (its positive one): NaN takes the node next
  double y = kUnknown;      ///<   to the array's middle, lenslet units
  int charge = 1;           ///< `vortex`: +1 or −1
  double alpha_rad = 0.0;   ///< `vortex`, `dipole`: morphology α in [0, π/2)
  double beta_rad = 0.0;    ///< `vortex`, `dipole`: morphology β
  double separation = 2.0;  ///< `dipole`: the negative one lies this far along +x, pitches
  double tilt_x_rad = 0.5;  ///< `tilt`: rad per pitch along x
  double tilt_y_rad = 0.0;  ///< `tilt`: rad per pitch along y
  int noll = 4;             ///< `zernike`: Noll's index
  double rms_rad = 1.0;     ///< `zernike`: root mean square
  std::string field_file;   ///< `field`: FITS file, see read_sampled_field
};

/// The presets' names: plane, tilt, zernike, vortex, dipole, field, turbulence, chen2007.
const std::vector<std::string>& simulator_presets();

/// Adds a preset to the scene in `options`; what is there already stays, so that presets combine.
/// rows and cols must be set. Throws UsageError for an unknown name, listing the known ones.
void add_preset(std::string_view name, const PresetParameters& parameters,
                SimulatorOptions& options);

/// Throws UsageError with one sentence for numbers that make no sense.
void check_simulator_options(const SimulatorOptions& options);

/// Whether photons, background and read noise are drawn at all.
bool is_noisy(const SimulatorOptions& options);

/// The grid that turbulence is simulated on; options must have it. Throws as choose_grid does.
PropagationGrid propagation_grid(const SimulatorOptions& options);

/// The field points a lenslet that turbulence must deliver: the far field is as wide as the window,
/// and its side lobes about right.
int min_field_samples(const SimulatorOptions& options);

/// 1 where a lenslet is in the pupil, else 0; [rows, cols].
Image<std::uint8_t> find_lit_lenslets(const SimulatorOptions& options);

/// The radius, in pitches, of the smallest disc round the pupil: the circle itself, or for a square
/// pupil the one through its corners. Zernike polynomials are normalised over it.
double pupil_disc_radius(const SimulatorOptions& options);

}  // namespace curlew
