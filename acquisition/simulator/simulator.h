// A Simulator makes frames of a Shack–Hartmann sensor from physical optics, with their truth.
#pragma once

#include <complex>
#include <cstdint>
#include <optional>
#include <vector>

#include "acquisition/frame_source.h"
#include "acquisition/recording/truth_vortex.h"
#include "acquisition/simulator/field.h"
#include "acquisition/simulator/lenslet_optics.h"
#include "acquisition/simulator/propagation.h"
#include "acquisition/simulator/simulator_options.h"
#include "core/image.h"
#include "core/lenslet_grid.h"
#include "core/optics.h"

namespace curlew {

/// Computes physical optics from the field at the lenslets to counts.
///
/// Each lit lenslet's field goes to its far field (LensletOptics), which falls on the detector
/// round its own axis; light of different lenslets adds in intensity, never in amplitude. Then come
/// photons, background, read noise, gain, bias, rounding and saturation. The spot of a plane wave
/// lies at pixel ((window_px−1)/2 + col·window_px, (window_px−1)/2 + row·window_px); a slope of s
/// rad per pitch moves it by s·samples_per_lambda_w/2π pixels.
///
/// The mean image is computed once unless vortices move or there is turbulence. Frames carry
/// camera_ns as of a camera of 1 kHz, and received_ns 0, so that a recording has the same bytes
/// whenever it is made.
///
/// The values of a field file are scaled to a mean |field|² of 1 over the lit lenslets.
class Simulator final : public FrameSource {
 public:
  /// By the camera's clock a frame comes so long after the one before it.
  static constexpr std::int64_t kFramePeriodNs = 1'000'000;

  /// Throws UsageError for options that make no sense, Failure for a field file that cannot be
  /// used.
  explicit Simulator(SimulatorOptions options);

  const FrameFormat& format() const override { return format_; }
  std::int64_t frame_count() const override { return options_.frames < 0 ? -1 : options_.frames; }
  Delivery next(FrameBuffer& into) override;

  /// Makes frame `frame` (from 0), whichever frames were asked for before.
  void render(std::int64_t frame, FrameBuffer& into);

  const Optics& optics() const { return optics_; }
  const Detector& detector() const { return detector_; }
  /// Returns where the plane wave's spots lie.
  LensletGrid grid() const;
  /// Returns 1 where a lenslet is in the pupil, else 0; [rows, cols].
  const Image<std::uint8_t>& lit() const { return lit_; }

  /// Returns the vortices of a frame on the array (within half a pitch of a lenslet's centre). The
  /// separation is to the nearest opposite one, on the array or off it (behind turbulence: up to 4
  /// pitches off, if the grid goes that far); infinite if there is none.
  std::vector<TruthVortex> truth(std::int64_t frame);

  /// Returns all vortices of a frame, those off the array too, as far as they are known.
  std::vector<SceneVortex> vortices(std::int64_t frame);

  /// Returns the complex field over the array in a frame, before the pupil; its values are [rows·n,
  /// cols·n].
  SampledField field(std::int64_t frame);

  /// Returns the mean electrons per pixel, background included, in that frame; [rows, cols] of
  /// pixels.
  const Image<float>& expected_image_e(std::int64_t frame = 0);

 private:
  Simulator(const SimulatorOptions& options, SampledField field);

  void move_beam_to(std::int64_t frame);
  void compute_expected_image(std::int64_t frame);
  template <typename Count>
  bool expose(std::int64_t frame, Count* counts) const noexcept;

  SimulatorOptions options_;
  FrameFormat format_;
  Optics optics_;
  Detector detector_;
  Image<std::uint8_t> lit_;
  std::optional<Propagation> propagation_;
  Beam beam_;
  std::int64_t beam_frame_ = -1;  ///< the frame whose turbulence the beam has come through
  LensletOptics lenslet_optics_;
  /// Electrons per lenslet of unit amplitude; 0 until an image says how many fill the range.
  double electrons_;
  Image<std::complex<double>> lenslet_field_;
  Image<double> patch_;
  Image<float> expected_e_;
  std::int64_t expected_frame_ = -1;
  std::int64_t next_frame_ = 0;
};

}  // namespace curlew
