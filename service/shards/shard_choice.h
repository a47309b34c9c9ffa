// Which part of a night's frames one worker takes.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

namespace curlew {

struct ShardChoice {
  int shard = 0;        ///< from 1; 0: every shard in turn, and then their merge
  int shards = 0;       ///< of the night
  bool merges = false;  ///< whether this worker merges the shards once all are there

  bool operator==(const ShardChoice&) const = default;
};

/// Returns the value of a variable of the environment; null if there is none.
using Environment = std::function<const char*(const char* name)>;

/// Reads "3/64", "all/64", or "auto", which takes what mpirun (its rank 0 merges) or a Slurm array
/// (from 0 or 1 without gaps) says of itself. Throws UsageError for anything else.
ShardChoice choose_shard(const std::string& word, const Environment& environment);

struct FrameRange {
  std::int64_t first = 0;
  std::int64_t frames = 0;

  bool operator==(const FrameRange&) const = default;
};

/// Returns the frames of one shard of a night; all shards together are the night, and their lengths
/// differ by one frame at most. Throws UsageError if there are fewer frames than shards.
FrameRange range_of_shard(int shard, int shards, std::int64_t frames_of_night);

/// Returns "night.shard-0003-of-0064.fits" for "night.fits".
std::string shard_path(const std::string& out, int shard, int shards);

}  // namespace curlew
