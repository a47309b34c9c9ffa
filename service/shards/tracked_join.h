// The tables FRAMES, VORTICES and TRACKS of a night whose vortices are tracked.
#pragma once

#include <cstddef>
#include <functional>
#include <span>
#include <vector>

#include "detect/tracking/vortex_tracker.h"
#include "service/results/result_rows.h"
#include "service/results/row_table.h"
#include "service/results/track_summary.h"
#include "service/shards/byte_reader.h"
#include "service/shards/shard_record.h"

namespace curlew {

/// Runs the tracker over the candidates of all shards, as one run would have. Rows of the tables
/// FRAMES and VORTICES go on as they come.
class TrackedJoin {
 public:
  using TakeRows = RowTable::TakeRows;

  TrackedJoin(const ShardRecord& night, TakeRows take_frames, TakeRows take_vortices);

  /// Tracks through one shard after the other. frames and candidates: rows of their tables, from
  /// the first of this shard on.
  void add(std::int64_t n_frames, ByteReader& frames, ByteReader& candidates);
  /// Gives the last rows.
  void finish() { vortex_table_.flush(); }

  std::int64_t vortices() const { return vortex_table_.rows(); }
  const TrackSummary& tracks() const { return track_summary_; }

 private:
  void track_frame(std::byte* row, ByteReader& candidates);

  LensletGrid grid_;
  VortexTracker tracker_;
  VortexRow vortex_row_;
  VortexList tracked_;
  VortexList vortices_;
  TakeRows take_frames_;
  RowTable vortex_table_;
  TrackSummary track_summary_;
  std::vector<std::byte> candidate_;
  std::size_t frame_bytes_, frame_, sequence_, camera_ns_, received_ns_, n_vortices_, overflow_;
};

}  // namespace curlew
