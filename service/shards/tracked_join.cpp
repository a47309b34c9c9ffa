#include "service/shards/tracked_join.h"

#include <algorithm>
#include <utility>

#include "core/as_size.h"
#include "core/error.h"
#include "service/frame_time.h"

namespace curlew {

TrackedJoin::TrackedJoin(const ShardRecord& night, TakeRows take_frames, TakeRows take_vortices)
    : grid_(night.grid),
      tracker_(night.tracker.value_or(TrackerOptions{}), grid_.rows, grid_.cols,
               as_size(night.candidate_capacity)),
      tracked_(as_size(night.candidate_capacity)),
      vortices_(as_size(night.vortex_capacity)),
      take_frames_(std::move(take_frames)),
      vortex_table_("VORTICES", vortex_columns(), std::move(take_vortices)),
      candidate_(vortex_row_.bytes()) {
  const std::vector<ColumnSpec> columns = frame_columns();
  const auto at = [&](const char* name) { return cell_offset(columns, name); };
  frame_bytes_ = row_bytes(columns);
  frame_ = at("FRAME");
  sequence_ = at("SEQUENCE");
  camera_ns_ = at("CAMERA_NS");
  received_ns_ = at("RECEIVED_NS");
  n_vortices_ = at("N_VORTICES");
  overflow_ = at("OVERFLOW");
}

void TrackedJoin::add(std::int64_t n_frames, ByteReader& frames, ByteReader& candidates) {
  constexpr std::int64_t kBlockRows = 4096;
  std::vector<std::byte> block;
  while (n_frames > 0) {
    const std::size_t rows = as_size(std::min(n_frames, kBlockRows));
    block.resize(rows * frame_bytes_);
    frames.read(block);
    for (std::size_t i = 0; i < rows; ++i) track_frame(block.data() + i * frame_bytes_, candidates);
    take_frames_(block);
    n_frames -= static_cast<std::int64_t>(rows);
  }
}

/// Makes of a frame's candidates its vortices, and counts these in the frame's row.
void TrackedJoin::track_frame(std::byte* row, ByteReader& candidates) {
  const auto frame = cell_value<std::int64_t>(row + frame_);
  tracked_.clear();
  for (auto n = cell_value<std::int32_t>(row + n_vortices_); n > 0; --n) {
    candidates.read(candidate_);
    if (vortex_row_.frame(candidate_.data()) != frame)
      throw Failure("a shard's candidates are not those of its frames: do it again");
    tracked_.push(vortex_row_.vortex(candidate_.data()));
  }
  tracked_.add_overflow(cell_value<std::int32_t>(row + overflow_));
  FrameHeader header;
  header.sequence = cell_value<std::int64_t>(row + sequence_);
  header.camera_ns = cell_value<std::int64_t>(row + camera_ns_);
  header.received_ns = cell_value<std::int64_t>(row + received_ns_);
  tracker_.update(time_s(header), tracked_);
  vortices_.assign(tracked_);
  for (const Vortex& vortex : vortices_) append_vortex(vortex_table_, frame, vortex, grid_);
  track_summary_.add(frame, header, vortices_);
  put_cell(row + n_vortices_, static_cast<std::int32_t>(vortices_.size()));
  put_cell(row + overflow_, static_cast<std::int32_t>(vortices_.overflow()));
}

}  // namespace curlew
