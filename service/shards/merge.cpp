#include "service/shards/merge.h"

#include <fcntl.h>
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <memory>
#include <optional>
#include <utility>

#include "acquisition/fits/file_descriptor.h"
#include "acquisition/fits/hdu_bytes.h"
#include "core/error.h"
#include "service/program/interrupt.h"
#include "service/program/version.h"
#include "service/results/results_file.h"
#include "service/shards/joined_file.h"
#include "service/shards/shard_record.h"
#include "service/shards/tracked_join.h"

namespace curlew {
namespace {

/// One shard, open. Its last HDU, the record, is not among `hdus`.
struct Shard {
  std::string path;
  ShardRecord record;
  FileDescriptor file{};
  std::vector<HduBytes> hdus{};

  ByteReader data_of(std::size_t hdu) const {
    const HduBytes& part = hdus[hdu];
    return {file.get(), part.data, part.data + part.slices * part.slice_bytes, path};
  }
};

Shard open_shard(const std::string& path) {
  Shard shard{.path = path, .record = read_shard_record(path)};
  shard.file = FileDescriptor(open(path.c_str(), O_RDONLY | O_CLOEXEC));
  shard.hdus = find_hdu_bytes(shard.file.get());
  if (shard.hdus.empty()) throw Failure(path + " cannot be read again");
  shard.hdus.pop_back();
  return shard;
}

/// Refuses shards that are not all parts of one night, each once.
void require_one_night(const std::vector<Shard>& shards) {
  const Shard& first = shards.front();
  if (first.record.program != kProgram)
    throw Failure(
        fmt::format("{} was made by {} and this is {}: merge with the program that made "
                    "the shards",
                    first.path, first.record.program, kProgram));
  for (const Shard& shard : shards) {
    const std::string other = difference_of_nights(first.record, shard.record);
    if (!other.empty())
      throw Failure(fmt::format("{} is of {} than {}: only shards of one night are merged",
                                shard.path, other, first.path));
  }
  const int n = first.record.shards;
  for (int i = 1; i <= n; ++i) {
    const auto is_it = [i](const Shard& shard) { return shard.record.shard == i; };
    const auto found = std::find_if(shards.begin(), shards.end(), is_it);
    if (found == shards.end())
      throw Failure(
          fmt::format("shard {} of {} is missing: give 'curlew replay --shard {}/{}' with "
                      "the other options of the night",
                      i, n, i, n));
    if (const auto again = std::find_if(found + 1, shards.end(), is_it); again != shards.end())
      throw Failure(fmt::format("{} and {} are both shard {} of {}: name one of them", found->path,
                                again->path, i, n));
  }
}

/// Expects the shards in their order.
void require_joined(const std::vector<Shard>& shards) {
  const ShardRecord& night = shards.front().record;
  for (std::size_t i = 0; i < shards.size(); ++i) {
    const ShardRecord& record = shards[i].record;
    if (record.range != range_of_shard(record.shard, record.shards, record.night_frames))
      throw Failure(shards[i].path + " has other frames than its number says: do it again");
    if (i > 0 && record.windows_before != shards[i - 1].record.windows_after)
      throw Failure(fmt::format(
          "{} began with other windows than {} ended with: give 'curlew replay --shard {}/{}' "
          "again with the other options of the night, which begins where that ended",
          shards[i].path, shards[i - 1].path, record.shard, night.shards));
    bool alike = shards[i].hdus.size() == shards.front().hdus.size();
    for (std::size_t k = 0; alike && k < shards[i].hdus.size(); ++k)
      alike = shards[i].hdus[k].name == shards.front().hdus[k].name &&
              shards[i].hdus[k].slice_bytes == shards.front().hdus[k].slice_bytes;
    if (!alike) throw Failure(shards[i].path + " has other tables or images than the other shards");
  }
}

/// Puts the HDUs of all shards together, one after the other.
class Join {
 public:
  Join(const std::vector<Shard>& shards, const std::string& out) : shards_(shards), file_(out) {
    if (shards.front().record.tracker) tracked_.emplace(shards.front().record, out);
    for (std::size_t k = 0; k < shards.front().hdus.size(); ++k) {
      const std::string& name = shards.front().hdus[k].name;
      if (k == 0) {
        append_primary();
      } else if (name == "ZERNIKE_MODES") {  // what all shards have alike
        append_header(k, shards.front().hdus[k].slices);
        append_data(shards.front(), k);
      } else if (tracked_ && name == "FRAMES") {
        append_frames(k);
      } else if (tracked_ && name == "VORTICES") {
        append_rows(k, tracked_->vortices());
        vortices_ = tracked_->vortices().rows();
      } else if (tracked_ && name == "TRACKS") {
        append_rows(k, tracked_->tracks().table(out));
      } else {
        append_slices(k);
      }
      file_.end_hdu();
    }
  }

  std::int64_t vortices() const { return vortices_; }
  void commit() { file_.commit(); }

 private:
  void append_header(std::size_t hdu, std::int64_t slices) {
    file_.append(shards_.front().hdus[hdu].header_for(slices));
  }

  void append_rows(std::size_t hdu, const RowTable& table) {
    append_header(hdu, table.rows());
    table.for_each_block([&](std::span<const std::byte> rows) { file_.append(rows); });
  }

  void append_primary() {
    std::string header = shards_.front().hdus.front().header_for(0);
    const std::string was = fmt::format("CONTENT = '{}'", kShardContent);
    const std::string is = fmt::format("CONTENT = '{}'", kResultsContent);
    const std::size_t at = header.find(was);
    if (at == std::string::npos) throw Failure(shards_.front().path + " is no shard");
    header.replace(at, is.size(), is);
    file_.append(header);
  }

  void append_data(const Shard& shard, std::size_t hdu) {
    ByteReader reader = shard.data_of(hdu);
    for (auto block = reader.next_block(); !block.empty(); block = reader.next_block()) {
      if (interrupted()) throw Failure("interrupted: nothing was written");
      file_.append(block);
    }
  }

  void append_slices(std::size_t hdu) {
    std::int64_t slices = 0;
    for (const Shard& shard : shards_) slices += shard.hdus[hdu].slices;
    append_header(hdu, slices);
    for (const Shard& shard : shards_) append_data(shard, hdu);
    if (shards_.front().hdus[hdu].name == "VORTICES") vortices_ = slices;
  }

  void append_frames(std::size_t hdu) {
    const ShardRecord& night = shards_.front().record;
    append_header(hdu, night.night_frames);
    for (const Shard& shard : shards_) {
      const auto candidates = std::find_if(shard.hdus.begin(), shard.hdus.end(),
                                           [](const HduBytes& h) { return h.name == "VORTICES"; });
      ByteReader frame_rows = shard.data_of(hdu);
      ByteReader candidate_rows =
          shard.data_of(static_cast<std::size_t>(candidates - shard.hdus.begin()));
      tracked_->add(
          shard.record.range.frames, [&](std::span<std::byte> into) { frame_rows.read(into); },
          [&](std::span<std::byte> into) { candidate_rows.read(into); },
          [&](std::span<const std::byte> rows) { file_.append(rows); });
    }
  }

  const std::vector<Shard>& shards_;
  JoinedFile file_;
  std::optional<TrackedJoin> tracked_;
  std::int64_t vortices_ = 0;
};

}  // namespace

MergeReport merge_shards(const std::vector<std::string>& paths, const std::string& out) {
  if (paths.empty()) throw UsageError("no shard to merge was named");
  std::vector<Shard> shards;
  shards.reserve(paths.size());
  for (const std::string& path : paths) shards.push_back(open_shard(path));
  std::sort(shards.begin(), shards.end(), [](const Shard& a, const Shard& b) {
    return std::pair(a.record.shard, a.path) < std::pair(b.record.shard, b.path);
  });
  require_one_night(shards);
  require_joined(shards);
  MergeReport report{.frames = shards.front().record.night_frames,
                     .shards = shards.front().record.shards};
  for (const Shard& shard : shards) report.measured += shard.record.measured;
  Join join(shards, out);
  join.commit();
  report.vortices = join.vortices();
  return report;
}

}  // namespace curlew
