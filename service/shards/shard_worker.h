// ShardWorker does the shards of a night: what replay does, part by part.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "acquisition/recording/fits_source.h"
#include "service/program/outputs.h"
#include "service/results/results_file.h"
#include "service/shards/shard_record.h"
#include "service/stages.h"
#include "service/thread_placement.h"

namespace curlew {

/// A night as all its workers see it.
struct Night {
  std::vector<std::string> recordings;
  FrameSelection selection;
  std::shared_ptr<const Plan> plan;
  std::vector<std::string> saved;  ///< words of --save
  std::int64_t frames = 0;
  int shards = 0;
  std::string out;  ///< the results file, beside which the shards are
  Existing existing = Existing::kRefused;
};

/// Does shards so that their merge is, bit for bit, what one run gives. What frames teach the
/// windows crosses the seams: a shard begins with what the one before it ended with, where that is
/// done already. Otherwise it looks at kWarmUpFrames before its first, and the two are compared
/// when both are done (docs/adr/0010-seams.md).
class ShardWorker {
 public:
  static constexpr std::int64_t kWarmUpFrames = 8 * WindowFollower::kSettlingFrames;

  /// placement: must outlive the worker.
  ShardWorker(Night night, ThreadPlacement& placement);

  /// Does a shard, unless it is there, undamaged, and begins where the one before ended. Prints a
  /// line on it. Throws UsageError for a file of its name that is no shard of this night, unless
  /// that may be replaced.
  void do_shard(int shard) const;
  enum class Others { kNone, kAtWork };
  /// As do_shard() for all shards, in their order. Where others are at work it waits for each shard
  /// until one of them has done it, and does only what does not begin where the one before ended.
  /// Throws Failure when interrupted.
  void do_all_shards(Others others) const;
  /// Returns the files of all shards.
  std::vector<std::string> paths() const;

 private:
  std::string path_of(int shard) const;
  ShardRecord record_for(int shard) const;
  std::optional<ShardRecord> find_done(int shard) const;
  std::optional<ShardRecord> wait_for(int shard) const;
  void require_replaceable(int shard) const;
  ShardRecord do_unless_done(int shard, const std::optional<ShardRecord>& before,
                             const std::optional<ShardRecord>& done) const;
  ShardRecord run(int shard, const std::optional<ShardRecord>& before) const;

  Night night_;
  SaveOptions save_;
  ThreadPlacement& placement_;
  ShardRecord record_;  ///< what all shards have in common
};

}  // namespace curlew
