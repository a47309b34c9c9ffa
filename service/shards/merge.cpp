#include "service/shards/merge.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <functional>
#include <utility>

#include "acquisition/fits/file_descriptor.h"
#include "acquisition/fits/hdu_bytes.h"
#include "core/as_size.h"
#include "core/error.h"
#include "service/program/interrupt.h"
#include "service/program/version.h"
#include "service/results/results_file.h"
#include "service/results/track_summary.h"
#include "service/shards/byte_reader.h"
#include "service/shards/joined_file.h"
#include "service/shards/shard_record.h"
#include "service/shards/tasks.h"
#include "service/shards/tracked_join.h"

namespace curlew {
namespace {

/// One shard. Its last HDU, the record, is not among `hdus`.
struct Shard {
  std::string path;
  ShardRecord record;
  std::vector<HduBytes> hdus{};
};

Shard read_shard(const std::string& path) {
  Shard shard{.path = path, .record = read_shard_record(path)};
  const FileDescriptor file = open_for_reading(path);
  shard.hdus = contents_of_shard(path, shard.record, file.get());
  return shard;
}

/// Reads an HDU once, gives its data to `take` in their order, and refuses it where it is damaged.
template <typename Take>
void read_hdu(const Shard& shard, std::size_t hdu, const Take& take) {
  const HduBytes& part = shard.hdus[hdu];
  const FileDescriptor file = open_for_reading(shard.path);
  ByteReader reader(file.get(), part.begin, part.end, shard.path);
  const std::int64_t data_end = part.data + part.slices * part.slice_bytes;
  std::int64_t at = part.begin;
  for (auto block = reader.next_block(); !block.empty(); block = reader.next_block()) {
    if (interrupted()) throw Failure("interrupted: nothing was written");
    const auto size = static_cast<std::int64_t>(block.size());
    const std::int64_t first = std::clamp<std::int64_t>(part.data - at, 0, size);
    const std::int64_t last = std::clamp<std::int64_t>(data_end - at, first, size);
    if (last > first) take(block.subspan(as_size(first), as_size(last - first)));
    at += size;
  }
  require_undamaged(shard.path, shard.record, hdu, reader.digest_to_end());
}

/// What becomes of an HDU that all shards have.
enum class Joining {
  kFirst,    ///< that of the first shard is taken; the primary, and what all have alike
  kTracked,  ///< the tracker makes it
  kSlices    ///< the slices of all shards, one after the other
};

Joining joining_of(const Shard& shard, std::size_t hdu) {
  const std::string& name = shard.hdus[hdu].name;
  if (hdu == 0 || name == "ZERNIKE_MODES") return Joining::kFirst;
  const bool tracked = name == "FRAMES" || name == "VORTICES" || name == "TRACKS";
  return tracked && shard.record.tracker ? Joining::kTracked : Joining::kSlices;
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

/// Refuses shards that are damaged where a number that is not the one written might be believed.
/// Slices are only copied, and looked at on their way.
void require_undamaged_but_slices(const std::vector<Shard>& shards) {
  for (const Shard& shard : shards)
    for (std::size_t k = 0; k < shard.hdus.size(); ++k)
      if (joining_of(shard, k) != Joining::kSlices) read_hdu(shard, k, [](const auto&) {});
}

/// Puts the HDUs of all shards together. Where an HDU's place is known, its data are copied later,
/// all of them at once; the tracker runs beside them.
class Join {
 public:
  Join(const std::vector<Shard>& shards, const std::string& out)
      : shards_(shards), first_(shards.front()), file_(out) {
    for (std::size_t k = 0; k < first_.hdus.size(); ++k) {
      const std::string& name = first_.hdus[k].name;
      const Joining joining = joining_of(first_, k);
      if (k == 0) {
        append_primary();
      } else if (joining == Joining::kFirst) {
        append_header(k, first_.hdus[k].slices);
        append_data(first_, k);
      } else if (joining == Joining::kSlices) {
        append_slices(k);
      } else if (name == "FRAMES") {
        append_tracked(k, place_of("VORTICES"));
      } else if (name == "TRACKS") {
        append_tracks(k, out);
      }
      file_.end_hdu();
    }
    do_tasks(tasks_);
  }

  std::int64_t vortices() const { return vortices_; }
  void commit() { file_.commit(); }

 private:
  std::size_t place_of(const std::string& name) const {
    const auto found = std::find_if(first_.hdus.begin(), first_.hdus.end(),
                                    [&](const HduBytes& h) { return h.name == name; });
    if (found == first_.hdus.end()) throw Failure(first_.path + " has no table " + name);
    return static_cast<std::size_t>(found - first_.hdus.begin());
  }

  void append_header(std::size_t hdu, std::int64_t slices) {
    file_.append(first_.hdus[hdu].header_for(slices));
  }

  void append_primary() {
    std::string header = first_.hdus.front().header_for(0);
    const std::string was = fmt::format("CONTENT = '{}'", kShardContent);
    const std::string is = fmt::format("CONTENT = '{}'", kResultsContent);
    const std::size_t at = header.find(was);
    if (at == std::string::npos) throw Failure(first_.path + " is no shard");
    header.replace(at, is.size(), is);
    file_.append(header);
  }

  /// Leaves room for the data, and a task that copies them.
  void append_data(const Shard& shard, std::size_t hdu) {
    tasks_.emplace_back([this, &shard, hdu, place = file_.bytes()]() mutable {
      read_hdu(shard, hdu, [&](std::span<const std::byte> bytes) {
        file_.write_at(place, bytes);
        place += static_cast<std::int64_t>(bytes.size());
      });
    });
    file_.append_zeros(shard.hdus[hdu].slices * shard.hdus[hdu].slice_bytes);
  }

  void append_slices(std::size_t hdu) {
    std::int64_t slices = 0;
    for (const Shard& shard : shards_) slices += shard.hdus[hdu].slices;
    append_header(hdu, slices);
    for (const Shard& shard : shards_) append_data(shard, hdu);
    if (first_.hdus[hdu].name == "VORTICES") vortices_ = slices;
  }

  /// Appends FRAMES, whose length is known, and VORTICES behind it, in one pass through the shards.
  /// What comes behind them has its place only then, and what comes before is copied meanwhile.
  void append_tracked(std::size_t frames, std::size_t vortices) {
    append_header(frames, first_.record.night_frames);
    const std::int64_t frames_at = file_.bytes();
    file_.append_zeros(first_.record.night_frames * first_.hdus[frames].slice_bytes);
    file_.end_hdu();
    const std::int64_t header_at = file_.bytes();
    append_header(vortices, 0);
    Tasks tasks;
    tasks.reserve(1 + tasks_.size());
    tasks.emplace_back([&] { track(frames, vortices, frames_at); });
    for (std::function<void()>& copy : tasks_) tasks.push_back(std::move(copy));
    tasks_.clear();
    do_tasks(tasks);
    file_.write_at(header_at, first_.hdus[vortices].header_for(vortices_));
  }

  /// Writes the rows of FRAMES at their place and appends those of VORTICES.
  void track(std::size_t frames, std::size_t vortices, std::int64_t frames_at) {
    TrackedJoin tracked(
        first_.record,
        [&](std::span<const std::byte> rows) {
          file_.write_at(frames_at, rows);
          frames_at += static_cast<std::int64_t>(rows.size());
        },
        [&](std::span<const std::byte> rows) { file_.append(rows); });
    for (const Shard& shard : shards_) {
      const FileDescriptor file = open_for_reading(shard.path);
      const auto rows_of = [&](const HduBytes& hdu) {
        return ByteReader(file.get(), hdu.data, hdu.data + hdu.slices * hdu.slice_bytes,
                          shard.path);
      };
      ByteReader frame_rows = rows_of(shard.hdus[frames]);
      ByteReader candidate_rows = rows_of(shard.hdus[vortices]);
      tracked.add(shard.record.range.frames, frame_rows, candidate_rows);
      if (interrupted()) throw Failure("interrupted: nothing was written");
    }
    tracked.finish();
    vortices_ = tracked.vortices();
    tracks_ = tracked.tracks();
  }

  void append_tracks(std::size_t hdu, const std::string& out) {
    const RowTable table = tracks_.table(out);
    append_header(hdu, table.rows());
    table.for_each_block([&](std::span<const std::byte> rows) { file_.append(rows); });
  }

  const std::vector<Shard>& shards_;
  const Shard& first_;
  JoinedFile file_;
  Tasks tasks_;  ///< what is still to be copied
  TrackSummary tracks_;
  std::int64_t vortices_ = 0;
};

}  // namespace

MergeReport merge_shards(const std::vector<std::string>& paths, const std::string& out) {
  if (paths.empty()) throw UsageError("no shard to merge was named");
  std::vector<Shard> shards;
  shards.reserve(paths.size());
  for (const std::string& path : paths) shards.push_back(read_shard(path));
  std::sort(shards.begin(), shards.end(), [](const Shard& a, const Shard& b) {
    return std::pair(a.record.shard, a.path) < std::pair(b.record.shard, b.path);
  });
  require_one_night(shards);
  require_joined(shards);
  require_undamaged_but_slices(shards);
  MergeReport report{.frames = shards.front().record.night_frames,
                     .shards = shards.front().record.shards};
  for (const Shard& shard : shards) report.measured += shard.record.measured;
  Join join(shards, out);
  join.commit();
  report.vortices = join.vortices();
  return report;
}

}  // namespace curlew
