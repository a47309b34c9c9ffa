// FrameCopy: what the page shows of a frame, copied out of its slot.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "core/image.h"
#include "core/slope_field.h"
#include "service/results/frame_result.h"
#include "service/stages.h"

namespace curlew {

/// The maps of lenslets, beside the slopes, that the page shows.
enum class PageMap : std::uint8_t {
  kX,
  kY,
  kFlux,
  kMovedX,
  kMovedY,
  kPhase,
  kWholePhase,
  kCirculation
};

struct PageMapSource {
  const char* name;  ///< in messages
  const Image<float>& (*of)(const FrameSlot& slot);
};

/// In the order of PageMap. Circulation is [rows − 1, cols − 1]; all others are [rows, cols], and
/// the whole phase is empty where the plan does not ask for it.
extern const std::array<PageMapSource, 8> kPageMaps;

/// All buffers are made when the sizes are known; after that copy() never allocates.
class FrameCopy {
 public:
  FrameCopy() : result(0), slopes(0, 0) {}

  /// Copies the slot's frame and results, once its latency is complete. Where the buffers have
  /// other sizes it copies nothing, notes the sizes, and returns false.
  bool copy(const FrameSlot& slot, std::int64_t dropped) noexcept;

  /// Makes buffers of the sizes that the last copy() wanted.
  void fit();

  const Image<float>& map(PageMap which) const { return maps[static_cast<std::size_t>(which)]; }

  const Plan* plan = nullptr;  ///< names the plan; it may be gone
  FrameResult result;
  AlignedVector<std::byte> pixels;  ///< as they came
  FrameFormat format;
  std::array<Image<float>, kPageMaps.size()> maps;
  SlopeField slopes;  ///< without their variances
  Image<LensletState> state;
  Image<std::uint8_t> circulation_valid;
  double level_adu = 0.0;  ///< in the middle of the frame, above the dark; 0 if not followed
  double noise_adu = 0.0;  ///< between the spots, rms; 0 if not followed
  FollowState follow_state = FollowState::kSettled;
  int n_saturated = 0;  ///< lenslets with a saturated pixel

 private:
  struct Sizes {
    int rows = 0;
    int cols = 0;
    bool whole_phase = false;
    std::size_t pixel_bytes = 0;
    std::size_t vortices = 0;
    bool operator==(const Sizes&) const = default;
  };
  static Sizes sizes_of(const FrameSlot& slot) noexcept;

  Sizes sizes_;
  Sizes wanted_;
};

}  // namespace curlew
