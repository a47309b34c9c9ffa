// Prints vortices beside the truth.
#pragma once

#include <cstdint>
#include <span>

#include "service/results/truth_match.h"
#include "service/stages.h"

namespace curlew {

/// Prints the vortices of the first `show` frames that have any, beside the truth where it is
/// known, and counts hits and false alarms over all frames.
class VortexPrinter {
 public:
  VortexPrinter(const Truth& truth, const Config& config, std::int64_t show)
      : truth_(truth),
        show_probability_(config.detect.method != DetectMethod::kCirculation),
        show_track_(config.track.enabled),
        show_(show) {}

  void add(const FrameSlot& slot);
  void summarize() const;

 private:
  void print(std::int64_t frame, std::span<const Vortex> found, std::span<const TruthVortex> truth,
             const TruthMatch& match) const;

  const Truth& truth_;
  bool show_probability_;
  bool show_track_;
  std::int64_t show_;
  std::int64_t shown_ = 0;     ///< frames with vortices, printed or not
  std::int64_t hits_ = 0;      ///< of true vortices that can be asked of a detector
  std::int64_t required_ = 0;  ///< these: not in pairs closer than kClosestRequiredPair
  std::int64_t true_ = 0;      ///< all
  std::int64_t false_ = 0;
  double square_error_ = 0.0;
};

}  // namespace curlew
