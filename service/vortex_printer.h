// Prints vortices beside the truth.
#pragma once

#include <cstdint>
#include <span>

#include "service/stages.h"
#include "service/truth.h"

namespace curlew {

/// Prints the vortices of the first `show` frames that have any, beside the truth where it is
/// known, and counts hits and false alarms over all frames.
class VortexPrinter {
 public:
  VortexPrinter(const Truth& truth, std::int64_t show) : truth_(truth), show_(show) {}

  void add(const FrameSlot& slot);
  void summarize() const;

 private:
  void print(std::int64_t frame, std::span<const Vortex> found, std::span<const TruthVortex> truth,
             const TruthMatch& match) const;

  const Truth& truth_;
  std::int64_t show_;
  std::int64_t shown_ = 0;  ///< frames with vortices, printed or not
  std::int64_t hits_ = 0;
  std::int64_t found_ = 0;
  std::int64_t true_ = 0;
  double square_error_ = 0.0;
};

}  // namespace curlew
