#include "service/shards/shard_record.h"

#include <fcntl.h>
#include <spdlog/fmt/fmt.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <cstddef>
#include <span>
#include <string_view>
#include <system_error>

#include "acquisition/fits/bytes_digest.h"
#include "acquisition/fits/file_descriptor.h"
#include "acquisition/fits/fits_file.h"
#include "acquisition/fits/hdu_bytes.h"
#include "acquisition/pictures/picture_stack.h"
#include "core/as_size.h"
#include "core/error.h"
#include "service/results/results_file.h"
#include "service/shards/byte_reader.h"

namespace curlew {
namespace {

constexpr const char* kTable = "SHARD";
constexpr std::size_t kDigestCharacters = 16;

std::string text_of_digest(std::uint64_t digest) { return fmt::format("{:016x}", digest); }

/// Calls visit(column, member) for each member, but for those of the tracker. It is the one list of
/// what the table holds.
template <typename Record, typename Visitor>
void visit_record(Record& record, const Visitor& visit) {
  visit("PROGRAM", record.program);
  visit("INPUTS", record.inputs);
  visit("CONFHASH", record.configuration);
  visit("SENSHASH", record.sensor);
  visit("SAVED", record.saved);
  visit("NIGHT_FRAMES", record.night_frames);
  visit("SHARDS", record.shards);
  visit("ROWS", record.grid.rows);
  visit("COLS", record.grid.cols);
  visit("ORIGINX", record.grid.origin_x_px);
  visit("ORIGINY", record.grid.origin_y_px);
  visit("P11", record.grid.p11);
  visit("P12", record.grid.p12);
  visit("P21", record.grid.p21);
  visit("P22", record.grid.p22);
  visit("MAX_CANDIDATES", record.candidate_capacity);
  visit("MAX_VORTICES", record.vortex_capacity);
  visit("SHARD", record.shard);
  visit("FIRST", record.range.first);
  visit("FRAMES", record.range.frames);
  visit("MEASURED", record.measured);
  visit("WINDOWS_BEFORE", record.windows_before);
  visit("WINDOWS_AFTER", record.windows_after);
  visit("CONTENTS", record.contents);
}

/// The settings of the tracker; the program's version says all else.
template <typename Options, typename Visitor>
void visit_tracker(Options& tracker, const Visitor& visit) {
  visit("FALSE_TRACKS", tracker.false_tracks_per_frame);
  visit("MIN_PROBABILITY", tracker.min_probability);
  visit("MIN_PROBABILITY_SINGLE", tracker.min_probability_single);
  visit("LONGEST_GAP", tracker.longest_gap_frames);
}

struct FieldList {
  std::vector<RecordField> fields;

  void operator()(const char* name, const std::string& text) {
    fields.push_back({name, RecordKind::kText, "", text});
  }
  void operator()(const char* name, double value) {
    fields.push_back({name, RecordKind::kReal, "", value});
  }
  void operator()(const char* name, std::int64_t value) {
    fields.push_back({name, RecordKind::kInteger, "", value});
  }
  void operator()(const char* name, int value) { (*this)(name, std::int64_t{value}); }
};

struct FieldReader {
  FitsFile& file;

  void operator()(const char* name, std::string& text) const {
    file.read_column(name, 0, std::span(&text, 1));
    text.erase(text.find_last_not_of(' ') + 1);
  }
  void operator()(const char* name, double& value) const {
    file.read_column(name, 0, std::span(&value, 1));
  }
  void operator()(const char* name, std::int64_t& value) const {
    file.read_column(name, 0, std::span(&value, 1));
  }
  void operator()(const char* name, int& value) const {
    std::int64_t wide = 0;
    (*this)(name, wide);
    value = static_cast<int>(wide);
  }
};

std::vector<RecordField> fields_of(const ShardRecord& record) {
  FieldList list;
  const auto add = [&](const char* name, const auto& value) { list(name, value); };
  visit_record(record, add);
  list("TRACKED", record.tracker ? 1 : 0);
  const TrackerOptions tracker = record.tracker.value_or(TrackerOptions{});
  visit_tracker(tracker, add);
  return std::move(list.fields);
}

/// Returns the digest of the record, and so of all that it says of the file's other HDUs.
std::string digest_text(const ShardRecord& record) {
  BytesDigest digest;
  for (const RecordField& field : fields_of(record)) {
    std::string text = field.name + " ";
    if (const auto* words = std::get_if<std::string>(&field.value)) text += *words;
    if (const auto* integer = std::get_if<std::int64_t>(&field.value))
      text += std::to_string(*integer);
    if (const auto* real = std::get_if<double>(&field.value)) text += fmt::format("{}", *real);
    digest.add(std::as_bytes(std::span(text)));
  }
  return text_of_digest(digest.value());
}

[[noreturn]] void refuse_damaged(const std::string& path) {
  throw Failure(path + " is damaged: its bytes are not those that were written; do it again");
}

}  // namespace

std::string difference_of_nights(const ShardRecord& a, const ShardRecord& b) {
  if (a.program != b.program) return "another version of the program (" + b.program + ")";
  if (a.inputs != b.inputs || a.night_frames != b.night_frames) return "other recordings";
  if (a.sensor != b.sensor) return "another sensor";
  if (a.configuration != b.configuration) return "another configuration";
  if (a.saved != b.saved) return "other images (--save)";
  if (a.shards != b.shards) return "another number of shards";
  return {};
}

void append_shard_record(const std::string& path, ShardRecord record) {
  FileDescriptor file(open(path.c_str(), O_RDWR | O_APPEND | O_CLOEXEC));
  if (!file)
    throw Failure(path + " cannot be read again: " + std::generic_category().message(errno));
  record.contents.clear();
  for (const HduBytes& hdu : find_hdu_bytes(file.get()))
    record.contents +=
        text_of_digest(ByteReader(file.get(), hdu.begin, hdu.end, path).digest_to_end());
  std::vector<RecordField> fields = fields_of(record);
  fields.push_back({"DIGEST", RecordKind::kText, "", digest_text(record)});
  FitsFile table = FitsFile::create_in_memory(path);
  table.create_record(kTable, fields, true);
  // Before the table comes an empty primary HDU of one block.
  std::span<const std::byte> bytes = table.memory().subspan(as_size(kFitsBlock));
  while (!bytes.empty()) {
    const ssize_t n = write(file.get(), bytes.data(), bytes.size());
    if (n < 0 && errno == EINTR) continue;
    if (n < 0)
      throw Failure(path + " cannot be written: " + std::generic_category().message(errno));
    bytes = bytes.subspan(static_cast<std::size_t>(n));
  }
  if (close(file.release()) != 0)
    throw Failure(path + " cannot be written: " + std::generic_category().message(errno));
}

ShardRecord read_shard_record(const std::string& path) {
  FitsFile file = FitsFile::open(path);
  if (file.key_string("CONTENT") != kShardContent)
    throw Failure(path + " is no shard: 'curlew replay --shard' writes them");
  if (!file.try_select(kTable) || file.row_count() != 1)
    throw Failure(path + " is damaged: it was cut off; do it again");
  if (!file.has_column("CONTENTS"))
    throw Failure(path + " was made by an older version of Curlew; do it again with this one");
  ShardRecord record;
  std::string digest;
  const FieldReader read{file};
  visit_record(record, read);
  TrackerOptions tracker;
  visit_tracker(tracker, read);
  int tracked = 0;
  read("TRACKED", tracked);
  if (tracked != 0) record.tracker = tracker;
  read("DIGEST", digest);
  if (digest_text(record) != digest) refuse_damaged(path);
  return record;
}

void require_undamaged(const std::string& path, const ShardRecord& record, std::size_t hdu,
                       std::uint64_t digest) {
  const std::size_t at = hdu * kDigestCharacters;
  if (at >= record.contents.size() ||
      record.contents.compare(at, kDigestCharacters, text_of_digest(digest)) != 0)
    refuse_damaged(path);
}

std::vector<HduBytes> contents_of_shard(const std::string& path, const ShardRecord& record,
                                        int file) {
  std::vector<HduBytes> hdus = find_hdu_bytes(file);
  if (hdus.empty() || hdus.back().name != kTable ||
      record.contents.size() != (hdus.size() - 1) * kDigestCharacters)
    refuse_damaged(path);
  hdus.pop_back();
  return hdus;
}

ShardRecord read_whole_shard(const std::string& path) {
  ShardRecord record = read_shard_record(path);
  const FileDescriptor file = open_for_reading(path);
  const std::vector<HduBytes> hdus = contents_of_shard(path, record, file.get());
  for (std::size_t i = 0; i < hdus.size(); ++i)
    require_undamaged(path, record, i,
                      ByteReader(file.get(), hdus[i].begin, hdus[i].end, path).digest_to_end());
  return record;
}

std::string text_of(const FollowerMemory& memory) {
  std::string text = fmt::format("{};{};{},{},{},", memory.frames, memory.started ? 1 : 0,
                                 memory.level.noise, memory.level.bound, memory.level.floor);
  for (const float c : memory.model.x) text += fmt::format("{},", c);
  for (const float c : memory.model.y) text += fmt::format("{},", c);
  for (const std::int8_t seen : memory.seen) text += static_cast<char>('0' + seen);
  return text;
}

FollowerMemory follower_memory_from(const std::string& text, int rows, int cols) {
  FollowerMemory memory;
  const char* at = text.data();
  const char* const end = text.data() + text.size();
  bool good = true;
  const auto take = [&](auto& value) {
    const auto [next, error] = std::from_chars(at, end, value);
    good = good && error == std::errc{} && next != end;
    if (good) at = next + 1;  // past the separator
  };
  int started = 0;
  take(memory.frames);
  take(started);
  take(memory.level.noise);
  take(memory.level.bound);
  take(memory.level.floor);
  for (float& c : memory.model.x) take(c);
  for (float& c : memory.model.y) take(c);
  memory.started = started != 0;
  memory.seen = Image<std::int8_t>(rows, cols);
  if (!good || as_size(end - at) != memory.seen.size())
    throw Failure("a shard says something else of its windows than this program does");
  for (std::int8_t& seen : memory.seen) seen = static_cast<std::int8_t>(*at++ - '0');
  return memory;
}

std::string digest_of_inputs(const std::vector<std::string>& recordings,
                             const FrameSelection& selection) {
  constexpr std::int64_t kBlocks = 16, kBlockBytes = 4096;
  BytesDigest digest;
  const auto add_text = [&](const std::string& text) {
    digest.add(std::as_bytes(std::span(text)));
  };
  add_text("hdu " + selection.hdu);
  if (selection.region) add_text("region " + region_text(*selection.region));
  for (const std::string& recording : recordings) {
    for (const std::string& path :
         means_pictures(recording) ? find_pictures(recording) : std::vector{recording}) {
      const FileDescriptor file = open_for_reading(path);
      struct stat what {};
      if (fstat(file.get(), &what) != 0)
        throw Failure(path + " cannot be read: " + std::generic_category().message(errno));
      const std::int64_t size = what.st_size;
      add_text("bytes " + std::to_string(size));
      const std::int64_t last = std::max<std::int64_t>(size - kBlockBytes, 0);
      for (std::int64_t i = 0; i < kBlocks; ++i) {
        const std::int64_t begin = last / (kBlocks - 1) * i;
        const std::int64_t end = std::min(begin + kBlockBytes, size);
        digest.add(ByteReader(file.get(), begin, end, path).next_block());
      }
    }
  }
  return text_of_digest(digest.value());
}

}  // namespace curlew
