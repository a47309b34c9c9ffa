#include "service/shards/shard_choice.h"

#include <spdlog/fmt/fmt.h>

#include <charconv>
#include <filesystem>
#include <optional>
#include <string_view>

#include "core/error.h"

namespace curlew {
namespace {

constexpr int kMostShards = 100'000;

std::optional<int> number_in(std::string_view text) {
  int number = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (error != std::errc{} || end != text.data() + text.size()) return std::nullopt;
  return number;
}

std::optional<int> number_of(const Environment& environment, const char* name) {
  const char* text = environment(name);
  if (text == nullptr) return std::nullopt;
  const std::optional<int> number = number_in(text);
  if (!number || *number < 0)
    throw UsageError(fmt::format("--shard auto: {} is '{}', which is no number", name, text));
  return number;
}

ShardChoice from_environment(const Environment& environment) {
  const auto rank = number_of(environment, "OMPI_COMM_WORLD_RANK");
  const auto size = number_of(environment, "OMPI_COMM_WORLD_SIZE");
  if (rank && size) return {*rank + 1, *size, *rank == 0};
  const auto task = number_of(environment, "SLURM_ARRAY_TASK_ID");
  const auto first = number_of(environment, "SLURM_ARRAY_TASK_MIN");
  const auto last = number_of(environment, "SLURM_ARRAY_TASK_MAX");
  const auto count = number_of(environment, "SLURM_ARRAY_TASK_COUNT");
  if (!task || !first || !last || !count)
    throw UsageError(
        "--shard auto needs mpirun or a Slurm array, which set OMPI_COMM_WORLD_RANK or "
        "SLURM_ARRAY_TASK_ID: give --shard I/N");
  // Some tasks of an array given again must not be taken for the whole of a smaller one.
  if (*first > 1 || *last - *first + 1 != *count || *count == 1)
    throw UsageError(
        fmt::format("--shard auto: the Slurm array goes from {} to {} with {} tasks, which may be "
                    "a part of a larger one: give --shard I/N",
                    *first, *last, *count));
  return {*task - *first + 1, *count, false};
}

}  // namespace

ShardChoice choose_shard(const std::string& word, const Environment& environment) {
  ShardChoice choice;
  if (word == "auto") {
    choice = from_environment(environment);
  } else {
    const std::size_t slash = word.find('/');
    const std::string_view text(word);
    const bool all = text.substr(0, slash) == "all";
    const auto shard = all ? 0 : number_in(text.substr(0, slash));
    const auto shards =
        slash == std::string::npos ? std::nullopt : number_in(text.substr(slash + 1));
    if (!shard || !shards)
      throw UsageError("--shard must be I/N, all/N or auto, not '" + word + "'");
    choice = {*shard, *shards, all};
    if (!all && *shard < 1) choice.shard = -1;
  }
  if (choice.shards < 1 || choice.shards > kMostShards || choice.shard < 0 ||
      choice.shard > choice.shards)
    throw UsageError(fmt::format("--shard {}: shards count from 1 to N, and N is at most {}", word,
                                 kMostShards));
  return choice;
}

FrameRange range_of_shard(int shard, int shards, std::int64_t frames_of_night) {
  if (frames_of_night < shards)
    throw UsageError(
        fmt::format("--shard: {} frames cannot be cut into {} shards", frames_of_night, shards));
  // The product would overflow for more frames than a night of any camera has.
  const auto begin = [&](std::int64_t i) {
    const std::int64_t whole = frames_of_night / shards, rest = frames_of_night % shards;
    return whole * i + rest * i / shards;
  };
  return {begin(shard - 1), begin(shard) - begin(shard - 1)};
}

std::string shard_path(const std::string& out, int shard, int shards) {
  std::filesystem::path path(out);
  const std::string extension = path.extension() == ".fits" ? ".fits" : "";
  if (!extension.empty()) path.replace_extension();
  return fmt::format("{}.shard-{:04}-of-{:04}.fits", path.string(), shard, shards);
}

}  // namespace curlew
