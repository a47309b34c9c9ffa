// AirMeter makes the figures of the air from the pipeline's results.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "reconstruct/air/air_figures.h"
#include "service/stages.h"

namespace curlew {

struct AirReport {
  AirFigures figures;
  /// Why r0 and the coherence time are not told, or r0_zernike alone; empty: they are.
  std::string without_r0;
  double pitch_m = 0.0;  ///< 0: not known
  std::int64_t first_frame = 0;
  std::int64_t last_frame = 0;
};

/// One figure as it is shown.
struct AirEntry {
  const char* name;  ///< with its unit, as r0_pitches
  const char* meaning;
  AirFigure figure;
};
std::vector<AirEntry> entries_of(const AirReport& report);

/// Returns why slopes do not tell r0 where light scintillates like this; empty if they do. Each
/// vortex and each dark lenslet adds slopes that are not those of the phase, and diffraction on a
/// path of unknown length takes some away. fresnel_pitches: see AirOptions; 0: the air is near.
std::string doubt_of_r0(const AirFigure& scintillation, double fresnel_pitches);

/// Returns why modes do not tell r0 where diffraction reaches that far over an array of so many
/// lenslets; empty if they do.
std::string doubt_of_modes(double fresnel_pitches, int lenslets);

/// Returns a few lines for people; figures that are not known are left out.
std::string air_text(const AirReport& report);

/// Measures window after window.
class AirMeter {
 public:
  AirMeter(const Plan& plan, const AirOptions& options);

  AirSample make_sample() const;
  /// Copies what counts of the slot, and sums up the light of its frame. Never allocates.
  static void fill(const FrameSlot& slot, AirSample& sample) noexcept;

  /// Returns the report of a window that is complete without this frame, which begins the next.
  /// Where the clock goes back before a window's first frame, that window is given up.
  std::optional<AirReport> add(const AirSample& sample, std::int64_t frame_index);
  /// Returns the report of the window as far as it has come.
  AirReport report() const;

 private:
  AirPlan plan_;
  AirWindow window_;
  double window_s_;
  double fresnel_pitches_;
  double pitch_m_;
  std::size_t vortices_;
  std::optional<double> begin_s_;
  std::int64_t first_frame_ = 0;
  std::int64_t last_frame_ = 0;
};

}  // namespace curlew
