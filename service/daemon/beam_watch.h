// BeamWatch tells where the beam is on the lenslets, and when it leaves them.
#pragma once

#include <optional>
#include <string>

#include "core/centroids.h"
#include "core/image.h"
#include "service/page/asked_copy.h"
#include "service/results/beam_figures.h"
#include "service/stages.h"

namespace curlew {

/// The light of one frame.
class BeamSample {
 public:
  /// As AskedCopy asks for.
  bool copy(const FrameSlot& slot) noexcept;
  void fit();

  Image<float> flux_adu;
  Image<LensletState> state;

 private:
  int rows_ = 0;
  int cols_ = 0;
};

struct BeamReport {
  BeamFigures figures;    ///< of the mean light of a second
  double pitch_m = 0.0;   ///< of the lenslets
  std::string warning{};  ///< a sentence, where the array's edge cuts the beam
};

/// What the beam is held against: that of the calibration.
struct BeamReference {
  BeamFigures figures;
  double pitch_m = 0.0;
};

/// One thread calls it, but for the tap.
class BeamWatch {
 public:
  BeamWatch() { tap_.ask(); }

  /// The publisher's thread offers each frame's slot here.
  AskedCopy<BeamSample>& tap() { return tap_; }

  /// Takes up the frame that has passed since the last call, if one has, and asks for the next.
  void look();

  /// Returns what the frames since the last call were like together; nothing where there was none.
  /// Call it once a second: the warning comes when the beam was cut in three of these in a row, and
  /// goes likewise, so that light that flickers raises none. Where all light goes after that, the
  /// beam has left the array.
  std::optional<BeamReport> second_over(const BeamReference& reference);

 private:
  std::string judge(const BeamFigures& beam, const BeamReference& reference);

  AskedCopy<BeamSample> tap_;
  int frames_ = 0;  ///< in these sums
  Image<float> light_;
  Image<std::uint8_t> lit_;
  std::string edges_;  ///< over which the beam is said to leave; empty: over none
  int otherwise_ = 0;  ///< seconds in a row that say otherwise
};

}  // namespace curlew
