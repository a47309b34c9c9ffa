#include "service/page/frame_copy.h"

#include <algorithm>
#include <cstring>

namespace curlew {
namespace {

/// Copies between images of one size.
template <typename T>
void copy_image(const Image<T>& from, Image<T>& to) noexcept {
  std::copy(from.begin(), from.end(), to.begin());
}

}  // namespace

const std::array<PageMapSource, 8> kPageMaps = {{
    {"x_px", [](const FrameSlot& s) -> const Image<float>& { return s.centroids.x_px; }},
    {"y_px", [](const FrameSlot& s) -> const Image<float>& { return s.centroids.y_px; }},
    {"flux_adu", [](const FrameSlot& s) -> const Image<float>& { return s.centroids.flux_adu; }},
    {"moved_x_px",
     [](const FrameSlot& s) -> const Image<float>& { return s.centroids.moved_x_px; }},
    {"moved_y_px",
     [](const FrameSlot& s) -> const Image<float>& { return s.centroids.moved_y_px; }},
    {"phase_rad", [](const FrameSlot& s) -> const Image<float>& { return s.split.phase; }},
    {"whole_phase_rad", [](const FrameSlot& s) -> const Image<float>& { return s.whole_phase; }},
    {"circulation_rad",
     [](const FrameSlot& s) -> const Image<float>& { return s.circulation.value; }},
}};

FrameCopy::Sizes FrameCopy::sizes_of(const FrameSlot& slot) noexcept {
  return {slot.slopes.rows(), slot.slopes.cols(), !slot.whole_phase.empty(),
          slot.frame->format().bytes(), slot.vortices.capacity()};
}

bool FrameCopy::copy(const FrameSlot& slot, std::int64_t dropped) noexcept {
  wanted_ = sizes_of(slot);
  if (!(wanted_ == sizes_)) return false;
  plan = slot.plan;
  result.copy(slot, dropped);
  format = slot.frame->format();
  std::memcpy(pixels.data(), slot.frame->view().pixels, pixels.size());
  for (std::size_t i = 0; i < maps.size(); ++i) copy_image(kPageMaps[i].of(slot), maps[i]);
  copy_image(slot.slopes.x, slopes.x);
  copy_image(slot.slopes.y, slopes.y);
  copy_image(slot.slopes.valid, slopes.valid);
  slopes.n_valid = slot.slopes.n_valid;
  copy_image(slot.centroids.state, state);
  copy_image(slot.circulation.valid, circulation_valid);
  level_adu = noise_adu = 0.0;
  if (slot.levels) {
    const Image<float>& level = slot.levels->level;
    const auto middle = static_cast<double>(level(level.rows() / 2, level.cols() / 2));
    level_adu = format.scale_adu * middle;
    noise_adu = format.scale_adu * static_cast<double>(slot.levels->noise);
  }
  follow_state = slot.follower != nullptr ? slot.follow_state : FollowState::kSettled;
  n_saturated = slot.centroids.n_saturated;
  return true;
}

void FrameCopy::fit() {
  sizes_ = wanted_;
  const int rows = sizes_.rows;
  const int cols = sizes_.cols;
  result = FrameResult(sizes_.vortices);
  pixels.resize(sizes_.pixel_bytes);
  for (Image<float>& map : maps) map = Image<float>(rows, cols);
  maps[static_cast<std::size_t>(PageMap::kCirculation)] = Image<float>(rows - 1, cols - 1);
  if (!sizes_.whole_phase) maps[static_cast<std::size_t>(PageMap::kWholePhase)] = {};
  slopes = SlopeField(rows, cols);
  state = Image<LensletState>(rows, cols);
  circulation_valid = Image<std::uint8_t>(rows - 1, cols - 1);
}

}  // namespace curlew
