// Which windows hold the spots of their lenslets, and where these lie as a whole.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "centroiding/centroid.h"
#include "centroiding/low_orders.h"
#include "centroiding/sensor.h"
#include "centroiding/spot_marks.h"
#include "core/centroids.h"
#include "core/image.h"

namespace curlew {

/// How the spots of one frame lie in their windows.
struct SpotFit {
  LowOrders model;        ///< displacements from where the windows are, px
  float residual_px = 0;  ///< of the spots from it, rms along an axis
  float largest_px = 0;   ///< of the model, over the spots
  int spots = 0;          ///< lenslets with a well-formed spot near the model
  int light = 0;          ///< lenslets with any light worth speaking of
  int faint = 0;          ///< lenslets with faint light, if not far dimmer than the spots
  bool same_lit = true;   ///< whether the lit lenslets are those of the frames before
};

/// Where the windows are, [rows, cols]: the displacements, in px, of which they have been moved by
/// the whole pixels.
struct WindowPlaces {
  const Image<float>& x_px;
  const Image<float>& y_px;
};

/// Judges the lenslets of one sensor, frame by frame. It remembers which lenslets had a spot in the
/// frames before. Nothing but the constructor allocates.
class SpotJudge {
 public:
  SpotJudge(const Sensor& sensor, const CentroidPlan& plan);

  /// Which spots say where all of them are.
  enum class Witnesses : std::uint8_t { kValid, kFaintToo };

  /// Fits the low orders to a sample of the spots and says what each window holds.
  void look_at(const WindowPlaces& places, const Centroids& centroids, Witnesses witnesses,
               SpotFit& found) noexcept;

  /// Returns whether the spots are enough, and near enough to the fit, to move windows with it.
  bool is_believed(const SpotFit& found) const noexcept;

  /// Returns whether most of the light may be that of spots too faint to be valid.
  bool may_be_faint(const SpotFit& found) const noexcept {
    return !is_believed(found) || !found.same_lit || found.faint >= found.light;
  }
  /// Returns whether the beam is so faint that one by one many of its spots are not valid, and all
  /// of them together still lie where the fit says: at least half of the lenslets have one. `found`
  /// is what faint witnesses said.
  bool is_faint_beam(const SpotFit& found) const noexcept;

  /// Returns whether lenslet k's window held a spot near the model when it was looked at.
  bool has_spot(std::size_t k) const noexcept {
    const std::uint8_t spot = spot_[k];
    return (static_cast<int>(spot == kNearModel) | static_cast<int>(spot == kWellFormed)) != 0;
  }

  /// Marks the lenslets whose spot is lost, by what look_at() saw. A spot that is dim or as wide as
  /// its window is lost where less than three quarters of its neighbours have a spot, and a faint
  /// one or one at its window's edge where less than half have. Sets row_changed, [rows], to 1
  /// where a row has such a lenslet.
  void judge(Centroids& centroids, std::vector<std::uint8_t>& row_changed) const noexcept;

  /// Marks every lenslet with light as lost, and those without as lost or, if there is hardly any
  /// light in the frame, as dark.
  static void lose_all(bool dark, Centroids& centroids) noexcept;

  /// Remembers which lenslets had a spot.
  void remember(const Centroids& centroids) noexcept;

  /// What it remembers: whether there was a frame, and how often each lenslet had its spot, of the
  /// last ones, [rows, cols].
  bool started() const { return started_; }
  const Image<std::int8_t>& seen() const { return seen_; }
  /// Goes on as the judge did that remembered this of a sensor of the same size.
  void recall(bool started, const Image<std::int8_t>& seen);

  /// [rows, cols] 1 where a lenslet had its spot in most of the last frames.
  const Image<std::uint8_t>& lit() const { return lit_; }

 private:
  bool is_witness(const Centroids& centroids, std::size_t k, float typical) const noexcept;
  void fit(const WindowPlaces& places, const Centroids& centroids, float typical,
           SpotFit& found) noexcept;
  float typical_brightness(const Centroids& centroids, LensletState of) noexcept;
  void find_spots(const WindowPlaces& places, const Centroids& centroids, float typical,
                  SpotFit& found) noexcept;
  void reject_clumps(const Centroids& centroids, float typical, SpotFit& found) noexcept;
  bool has_stepped(int here) const noexcept;
  bool has_doubts(const Centroids& centroids, std::size_t first, std::size_t last) const noexcept;
  float kept_neighbours(int row, int col) const noexcept;
  void mark_lit() noexcept;

  float pitch_px_;
  Image<std::uint8_t> lenslet_;  ///< [rows, cols] 1 where the plan has one
  Image<float> ref_x_px_;
  Image<float> ref_y_px_;
  Image<float> flux_adu_;            ///< of the references
  Image<float> widest_px2_;          ///< A spot whose second moments are more is not well formed.
  float narrowest_px2_;              ///< A spot's second moments, x and y together, are not less.
  int lenslets_ = 0;                 ///< how many there are
  std::vector<std::size_t> sample_;  ///< the lenslets that are fitted
  std::vector<float> column_u_;      ///< [cols] the model's coordinate of a column

  // The state.
  Image<std::int8_t> seen_;  ///< how often a lenslet had its spot, of the last frames
  Image<std::uint8_t> lit_;  ///< whether it had, more often than not
  bool started_ = false;

  // Buffers of one frame.
  bool faint_count_ = false;        ///< whether faint spots are witnesses
  Image<std::uint8_t> spot_;        ///< what each window holds
  std::vector<float> values_;       ///< of the sample
  std::vector<std::uint8_t> near_;  ///< [sample] whether a spot takes part in the fit
};

}  // namespace curlew
