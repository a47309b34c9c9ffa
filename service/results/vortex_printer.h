// Prints vortices beside the truth.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "service/results/truth_match.h"
#include "service/stages.h"

namespace curlew {

/// Prints the vortices of the first `show` frames that have any, beside the truth if it is known,
/// and counts hits and false alarms over all frames. It also prints true vortices that were missed,
/// unless they belong to a close pair, because those are not required.
class VortexPrinter {
 public:
  VortexPrinter(const Truth& truth, const Plan& plan, std::int64_t show)
      : truth_(truth),
        show_probability_(plan.detect.choice().method != DetectMethod::kCirculation),
        show_track_(plan.tracker.has_value()),
        show_(show) {}

  void add(const FrameSlot& slot);
  void summarize() const;

 private:
  void print(std::int64_t frame, std::span<const Vortex> found, std::span<const TruthVortex> truth,
             const std::vector<GradedVortex>& graded, const TruthMatch& match) const;

  const Truth& truth_;
  bool show_probability_;
  bool show_track_;
  std::int64_t show_;
  std::int64_t shown_ = 0;  ///< frames with vortices, printed or not
  // All true vortices, and those of them that are required: they are in no opposite pair closer
  // than kClosestRequiredPair.
  std::int64_t true_ = 0;
  std::int64_t required_ = 0;
  // Every vortex that was found is counted in one of these four.
  std::int64_t hits_ = 0;        ///< it hit a required vortex
  std::int64_t excused_ = 0;     ///< it hit a vortex of a close pair
  std::int64_t unresolved_ = 0;  ///< it is an unresolved pair, of charge 0
  std::int64_t false_ = 0;
  double square_error_ = 0.0;
};

}  // namespace curlew
