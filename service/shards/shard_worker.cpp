#include "service/shards/shard_worker.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <optional>
#include <system_error>
#include <thread>
#include <utility>

#include "acquisition/fits/partial_path.h"
#include "core/error.h"
#include "service/feed.h"
#include "service/pipeline.h"
#include "service/program/interrupt.h"
#include "service/program/progress.h"
#include "service/program/version.h"

namespace curlew {
namespace {

namespace fs = std::filesystem;

/// Removes what workers that were killed have left of this file.
void remove_partials(const std::string& path) {
  const fs::path target = target_of(path);
  std::error_code ignored;
  for (const auto& entry : fs::directory_iterator(target.parent_path(), ignored)) {
    const std::string name = entry.path().filename().string();
    if (name.starts_with(target.filename().string() + ".") && name.ends_with(".partial"))
      fs::remove(entry.path(), ignored);
  }
}

/// A shard that is being written, under another name until it is complete.
class PartialShard {
 public:
  explicit PartialShard(const std::string& path)
      : target_(replaceable_target(path)), partial_(partial_path(target_)) {}
  PartialShard(const PartialShard&) = delete;
  PartialShard& operator=(const PartialShard&) = delete;
  ~PartialShard() {
    std::error_code ignored;
    fs::remove(partial_, ignored);
  }

  const std::string& path() const { return partial_; }
  void complete() const {
    std::error_code error;
    fs::rename(partial_, target_, error);
    if (error) throw Failure(target_ + " cannot be written: " + error.message());
  }

 private:
  std::string target_;
  std::string partial_;
};

/// Lets the windows begin where the shard before ended or, where that is not known, as they are
/// after some frames before this shard's first. The source is at frame `first` afterwards.
void approach(Pipeline& pipeline, FitsSource& source, std::int64_t first,
              const std::optional<ShardRecord>& before) {
  std::optional<FollowerMemory> memory = pipeline.memory();
  if (!memory) return source.skip(first);
  if (before) {
    source.skip(first);
    return pipeline.recall(
        follower_memory_from(before->windows_after, memory->seen.rows(), memory->seen.cols()));
  }
  memory->frames = std::max<std::int64_t>(first - ShardWorker::kWarmUpFrames, 0);
  source.skip(memory->frames);
  pipeline.recall(*memory);
  RecordedFeed feed(source, {.max_frames = first - memory->frames, .first_frame = memory->frames});
  pipeline.run(feed, {});
}

std::string windows_of(const Pipeline& pipeline) {
  const std::optional<FollowerMemory> memory = pipeline.memory();
  return memory ? text_of(*memory) : std::string();
}

}  // namespace

ShardWorker::ShardWorker(Night night, ThreadPlacement& placement)
    : night_(std::move(night)), save_(save_options_from(night_.saved)), placement_(placement) {
  const Plan& plan = *night_.plan;
  std::vector<std::string> saved = night_.saved;
  std::sort(saved.begin(), saved.end());
  saved.erase(std::unique(saved.begin(), saved.end()), saved.end());
  for (const std::string& word : saved) record_.saved += (record_.saved.empty() ? "" : ",") + word;
  record_.program = kProgram;
  record_.inputs = digest_of_inputs(night_.recordings, night_.selection);
  record_.configuration = config_hash(plan.config);
  record_.sensor = plan.sensor_hash;
  record_.night_frames = night_.frames;
  record_.shards = night_.shards;
  record_.grid = plan.grid;
  record_.tracker = plan.tracker;
  record_.candidate_capacity = static_cast<std::int64_t>(plan.detect.candidate_capacity());
  record_.vortex_capacity = static_cast<std::int64_t>(plan.detect.capacity());
}

std::string ShardWorker::path_of(int shard) const {
  return shard_path(night_.out, shard, night_.shards);
}

std::vector<std::string> ShardWorker::paths() const {
  std::vector<std::string> paths;
  for (int shard = 1; shard <= night_.shards; ++shard) paths.push_back(path_of(shard));
  return paths;
}

ShardRecord ShardWorker::record_for(int shard) const {
  ShardRecord record = record_;
  record.shard = shard;
  record.range = range_of_shard(shard, night_.shards, night_.frames);
  return record;
}

/// Returns the record of a shard that is there, undamaged and of this night. All of it is read.
std::optional<ShardRecord> ShardWorker::find_done(int shard) const {
  std::error_code none;
  if (shard < 1 || !fs::exists(path_of(shard), none)) return std::nullopt;
  try {
    ShardRecord record = read_whole_shard(path_of(shard));
    const ShardRecord wanted = record_for(shard);
    if (difference_of_nights(wanted, record).empty() && record.shard == shard &&
        record.range == wanted.range)
      return record;
  } catch (const Failure&) {
    // It is damaged, or something else; require_replaceable() looks at what may be replaced.
  }
  return std::nullopt;
}

/// Throws UsageError where there is something else in place of this shard of the night.
void ShardWorker::require_replaceable(int shard) const {
  const std::string path = path_of(shard);
  std::error_code none;
  if (!fs::exists(replaceable_target(path), none)) return;
  if (night_.existing == Existing::kReplaced) return;
  std::string what;
  try {
    what = "of " + difference_of_nights(record_for(shard), read_whole_shard(path));
  } catch (const Failure&) {
    // What was cut off or damaged has nothing to lose; a file that is no shard has.
    std::optional<std::string> content;
    try {
      content = FitsFile::open(path).key_string("CONTENT");
    } catch (const Failure&) {
      return;
    }
    if (content == kShardContent) return;
    what = "no shard";
  }
  throw UsageError(
      fmt::format("{} exists already and is {}: name another --out, or give --force to replace it",
                  path, what));
}

/// before, done: what the shard before this one and this one say, where they are done.
ShardRecord ShardWorker::do_unless_done(int shard, const std::optional<ShardRecord>& before,
                                        const std::optional<ShardRecord>& done) const {
  if (done && (!before || before->windows_after == done->windows_before)) {
    fmt::print("{} is done already\n", path_of(shard));
    return *done;
  }
  if (!done) require_replaceable(shard);
  remove_partials(path_of(shard));
  return run(shard, before);
}

void ShardWorker::do_shard(int shard) const {
  do_unless_done(shard, find_done(shard - 1), find_done(shard));
}

void ShardWorker::do_all_shards(Others others) const {
  std::optional<ShardRecord> before;
  for (int shard = 1; shard <= night_.shards; ++shard)
    before = do_unless_done(shard, before,
                            others == Others::kAtWork ? wait_for(shard) : find_done(shard));
}

ShardRecord ShardWorker::run(int shard, const std::optional<ShardRecord>& before) const {
  ShardRecord record = record_for(shard);
  const auto [first, frames] = record.range;
  FitsSource source(night_.recordings, night_.selection);
  Pipeline pipeline(night_.plan, night_.plan->config.pipeline, placement_.thread_start());
  approach(pipeline, source, first, before);
  record.windows_before = windows_of(pipeline);
  const PartialShard partial(path_of(shard));
  ResultsFile file(partial.path(), *night_.plan, save_, frames, ResultsContent::kShard);
  Progress progress(fmt::format("shard {} of {}", shard, night_.shards), frames);
  RecordedFeed feed(source, {.max_frames = frames, .first_frame = first});
  const RunReport report =
      pipeline.run(feed, {.publish = [&](const FrameSlot& slot) { file.add(slot); },
                          .finish =
                              [&](const FrameSlot& slot, std::int64_t) {
                                file.add_latency(slot);
                                progress.step();
                              }});
  if (interrupted())
    throw Failure(
        fmt::format("interrupted: shard {} is not written; the same command does it", shard));
  if (report.frames != frames)
    throw Failure(fmt::format("the recordings became shorter: shard {} has {} of {} frames", shard,
                              report.frames, frames));
  record.windows_after = windows_of(pipeline);
  record.measured = report.measured;
  file.commit();
  append_shard_record(partial.path(), record);
  partial.complete();
  fmt::print("{}: frames {} to {} of {}, {:.1f} frames/s\n", path_of(shard), first,
             first + frames - 1, night_.frames,
             static_cast<double>(frames) / std::max(report.seconds, 1e-9));
  return record;
}

/// Returns the record of a shard once it is done.
std::optional<ShardRecord> ShardWorker::wait_for(int shard) const {
  constexpr auto kPeriod = std::chrono::milliseconds(200);
  while (true) {
    if (std::optional<ShardRecord> done = find_done(shard)) return done;
    if (interrupted()) throw Failure("interrupted while the other workers were not done");
    std::this_thread::sleep_for(kPeriod);
  }
}

}  // namespace curlew
