// What a shard says of itself: of which night it is, which part, and what joins it to the next.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "acquisition/fits/hdu_bytes.h"
#include "acquisition/recording/frame_selection.h"
#include "centroiding/window_follower.h"
#include "core/lenslet_grid.h"
#include "detect/tracking/tracker_options.h"
#include "service/shards/shard_choice.h"

namespace curlew {

/// The table SHARD, the last HDU of a shard.
struct ShardRecord {
  // The night. These are alike in all its shards.
  std::string program;        ///< name and version
  std::string inputs;         ///< digest_of_inputs()
  std::string configuration;  ///< config_hash()
  std::string sensor;         ///< sensor_hash()
  std::string saved;          ///< the images, separated by commas
  std::int64_t night_frames = 0;
  int shards = 0;
  LensletGrid grid;
  std::optional<TrackerOptions> tracker;  ///< with it, the shard has candidates for it
  std::int64_t candidate_capacity = 0;
  std::int64_t vortex_capacity = 0;

  // The shard.
  int shard = 0;  ///< from 1
  FrameRange range;
  std::int64_t measured = 0;  ///< valid lenslets, over all frames
  /// What frames had taught the windows before its first frame, and after its last; empty where
  /// windows stay. The one must be the other of the shard before.
  std::string windows_before;
  std::string windows_after;
  std::string contents;  ///< the digest of each HDU before this table, 16 characters each
};

/// Returns what of the night is another one in `b` than in `a`, as "another sensor"; empty if they
/// are of the same night.
std::string difference_of_nights(const ShardRecord& a, const ShardRecord& b);

/// Appends the table SHARD, with the digests of all that is before it, to a complete file. Throws
/// Failure when the disk is full.
void append_shard_record(const std::string& path, ShardRecord record);

/// Reads what a shard says of itself. Throws Failure for what is no shard, and for one that was cut
/// off or whose record is damaged. Its other HDUs are not looked at; see require_undamaged().
ShardRecord read_shard_record(const std::string& path);

/// As read_shard_record, and reads all of the shard. Throws Failure where any of it is damaged.
ShardRecord read_whole_shard(const std::string& path);

/// Returns the shard's HDUs but for the record. file: the shard, open. Throws Failure where there
/// are others than the record says.
std::vector<HduBytes> contents_of_shard(const std::string& path, const ShardRecord& record,
                                        int file);

/// Throws Failure unless the digest is the one that the shard's HDU of this index is to have.
void require_undamaged(const std::string& path, const ShardRecord& record, std::size_t hdu,
                       std::uint64_t digest);

/// Returns the memory as text of printable characters, and the memory of such a text. Every number
/// comes back as it was. Throws Failure for a text that is none.
std::string text_of(const FollowerMemory& memory);
FollowerMemory follower_memory_from(const std::string& text, int rows, int cols);

/// Returns a digest of which frames are read: of the length and some blocks of every file, and of
/// which part of them is selected. Throws Failure for a file that cannot be read.
std::string digest_of_inputs(const std::vector<std::string>& recordings,
                             const FrameSelection& selection);

}  // namespace curlew
