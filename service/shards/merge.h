// The merge of a night's shards into the results file that one run would have written.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace curlew {

struct MergeReport {
  std::int64_t frames = 0;
  std::int64_t vortices = 0;
  std::int64_t measured = 0;  ///< valid lenslets, over all frames
  int shards = 0;
};

/// Merges the shards at these paths, in any order, into a results file: bit for bit, but for the
/// latencies, what one run over the night writes. Images and tables are copied as bytes; where
/// vortices are tracked, the tracker runs over the shards' candidates. Memory does not grow with
/// the night. Throws Failure, and writes nothing, if a shard is missing, there twice, damaged, of
/// another night or another version, or if it began with other windows than the one before ended
/// with.
MergeReport merge_shards(const std::vector<std::string>& paths, const std::string& out);

}  // namespace curlew
