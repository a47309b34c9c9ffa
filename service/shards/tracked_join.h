// The tables FRAMES, VORTICES and TRACKS of a night whose vortices are tracked.
#pragma once

#include <cstddef>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "detect/tracking/vortex_tracker.h"
#include "service/results/result_rows.h"
#include "service/results/row_table.h"
#include "service/results/track_summary.h"
#include "service/shards/shard_record.h"

namespace curlew {

/// Runs the tracker over the candidates of all shards, as one run would have.
class TrackedJoin {
 public:
  /// beside: the file beside which rows wait, see RowTable.
  TrackedJoin(const ShardRecord& night, const std::string& beside);

  /// Tracks through one shard after the other. frames and candidates: rows of their tables; each
  /// gives so many bytes, from its file's next. Rows of FRAMES go to `out` as they are to be.
  using Reader = std::function<void(std::span<std::byte> into)>;
  void add(std::int64_t n_frames, const Reader& frames, const Reader& candidates,
           const std::function<void(std::span<const std::byte>)>& out);

  const RowTable& vortices() const { return vortex_table_; }
  const TrackSummary& tracks() const { return track_summary_; }

 private:
  void track_frame(std::byte* row, const Reader& candidates);

  LensletGrid grid_;
  VortexTracker tracker_;
  VortexRow vortex_row_;
  VortexList tracked_;
  VortexList vortices_;
  RowTable vortex_table_;
  TrackSummary track_summary_;
  std::vector<std::byte> candidate_;
  std::size_t frame_bytes_, frame_, sequence_, camera_ns_, received_ns_, n_vortices_, overflow_;
};

}  // namespace curlew
