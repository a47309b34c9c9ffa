// SimulatorOptions say what to simulate. The named presets are here, too.
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

/// Says where light goes that falls beyond its lenslet's window.
enum class StrayLight {
  kCropped,     ///< it is lost
  kNeighbours,  ///< it falls on the pixels of the lenslets around; their intensities add
};

struct SimulatorOptions {
  int rows = 16;                      ///< rows of lenslets
  int cols = 16;                      ///< columns of lenslets
  int window_px = 8;                  ///< pixels per lenslet side: the pitch on the detector
  double samples_per_lambda_w = 2.0;  ///< pixels per λ/w in the focus: 2 is a pixel of .5 λ/w
  /// Field points per lenslet side. A field file and turbulence bring their own.
  int field_samples = 32;
  PupilShape pupil = PupilShape::kSquare;
  double obscuration = 0.3;  ///< central disc's diameter over the circle's, in [0, 1)
  StrayLight stray_light = StrayLight::kCropped;

  /// Mean photo-electrons that a lit lenslet gathers, over its whole far field, where the amplitude
  /// is 1. If it is 0 or infinite, frames have no noise and no background, and are scaled so that
  /// the brightest pixel of frame 0 (behind turbulence: of each frame) lies three quarters of the
  /// way from bias to saturation.
  double photons = 5000.0;
  double background_e = 0.0;    ///< mean background per pixel, electrons, with its photon noise
  double read_noise_e = 1.0;    ///< Gaussian read noise, rms electrons per pixel
  double e_per_adu = 1.0;       ///< electrons a count stands for
  double bias_adu = 100.0;      ///< added to every pixel (use 10 or less with 8 bits)
  double saturation_adu = 0.0;  ///< pixels are cut off here; 0 if that is where the bits end
  int bit_depth = 12;           ///< 8 gives u8 frames, 10 to 16 give u16

  std::int64_t frames = 1;  ///< how many there are; negative if they have no end
  std::uint64_t seed = 1;   ///< seed of noise and turbulence; frame k depends on seed and k alone
  Scene scene;              ///< the beam; the default is a plane wave
  /// The beam comes through this before the scene multiplies it; without it, through nothing.
  std::optional<TurbulentPath> turbulence;
};

/// Says what the named presets are made from; each reads only its own values.
struct PresetParameters {
  /// `vortex`, `dipole` (its positive one): place in lenslet units; NaN takes the node next to the
  /// array's middle.
  double x = kUnknown;
  double y = kUnknown;      ///< as x
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

/// Returns the presets' names: plane, tilt, zernike, vortex, dipole, field, turbulence, chen2007.
const std::vector<std::string>& simulator_presets();

/// Adds a preset to the scene in `options`; what is there already stays, so that presets combine.
/// rows and cols must be set. Throws UsageError for an unknown name, listing the known ones.
void add_preset(std::string_view name, const PresetParameters& parameters,
                SimulatorOptions& options);

/// Throws UsageError with one sentence for numbers that make no sense.
void check_simulator_options(const SimulatorOptions& options);

/// Says whether photons, background and read noise are drawn at all.
bool is_noisy(const SimulatorOptions& options);

/// Returns the grid that turbulence is simulated on; options must have turbulence. Throws as
/// choose_grid does.
PropagationGrid propagation_grid(const SimulatorOptions& options);

/// Returns how many field points per lenslet turbulence must deliver, so that the far field is as
/// wide as the window and its side lobes are about right.
int min_field_samples(const SimulatorOptions& options);

/// Returns 1 where a lenslet is in the pupil, else 0; [rows, cols].
Image<std::uint8_t> find_lit_lenslets(const SimulatorOptions& options);

/// Returns the radius, in pitches, of the smallest disc round the pupil: the circle itself, or for
/// a square pupil the one through its corners. Zernike polynomials are normalised over it.
double pupil_disc_radius(const SimulatorOptions& options);

}  // namespace curlew
