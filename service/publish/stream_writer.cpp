#include "service/publish/stream_writer.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <numeric>
#include <optional>
#include <system_error>

#include "core/error.h"
#include "core/utc_now.h"

namespace curlew {
namespace {

constexpr int kMostPosts = 10;
constexpr std::int64_t kNsPerS = 1'000'000'000;

/// The keywords of every stream, in this order.
enum Keyword : std::uint8_t {
  kCreator,
  kFrame,
  kSequence,
  kTime,
  kStatus,
  kUnit,
  kCount,
  kKeywords
};

[[noreturn]] void refuse(const std::string& path, const std::string& why) {
  throw Failure("stream " + path + " " + why);
}

timespec now(clockid_t clock) noexcept {
  timespec time{};
  clock_gettime(clock, &time);
  return time;
}

/// Returns the acquisition's time by CLOCK_TAI. The kernel knows how far it is from UTC, and all
/// programs of one machine must agree.
timespec tai_of(std::int64_t utc_ns) noexcept {
  if (utc_ns == 0) return {};
  const timespec tai = now(CLOCK_TAI);
  const timespec utc = now(CLOCK_REALTIME);
  const std::int64_t apart_ns = (tai.tv_sec - utc.tv_sec) * kNsPerS + tai.tv_nsec - utc.tv_nsec;
  return {utc_ns / kNsPerS + (apart_ns + kNsPerS / 2) / kNsPerS, utc_ns % kNsPerS};
}

template <std::size_t N>
void set_text(char (&field)[N], const std::string& text) {
  std::memset(field, 0, N);
  text.copy(field, N - 1);
}

void set_keyword(StreamKeyword& keyword, const char* name, char type, const std::string& comment) {
  set_text(keyword.name, name);
  keyword.type = type;
  set_text(keyword.comment, comment);
}

void set_keywords(std::span<StreamKeyword> keywords, const StreamDescription& description) {
  set_keyword(keywords[kCreator], "CREATOR", 'S', "program that writes this stream");
  set_text(keywords[kCreator].text, "curlew");
  set_keyword(keywords[kFrame], "FRAME", 'L', "frame since the program began, from 0");
  set_keyword(keywords[kSequence], "SEQUENCE", 'L', "frame by the camera's count");
  set_keyword(keywords[kTime], "_MAQTIME", 'L', "Frame acq time (us, CLOCK_REALTIME)");
  set_keyword(keywords[kStatus], "STATUS", 'L', "1 incomplete 2 late 4 saturated 8 gap before");
  set_keyword(keywords[kUnit], "UNIT", 'S', "unit of the values");
  set_text(keywords[kUnit].text, description.unit);
  if (description.count_name.empty()) {
    keywords[kCount].type = 'N';
  } else {
    set_keyword(keywords[kCount], description.count_name.c_str(), 'L', description.count_comment);
  }
}

/// Returns the metadata of a new stream, but for its version, which is written last.
StreamMetadata metadata_of(const StreamDescription& description) {
  constexpr std::uint64_t kMathData = 2;
  StreamMetadata metadata{};
  set_text(metadata.name, description.name);
  metadata.naxis = static_cast<std::uint8_t>(description.size.size());
  std::fill(std::begin(metadata.size), std::end(metadata.size), 1U);
  std::copy(description.size.begin(), description.size.end(), metadata.size);
  metadata.nelement = std::accumulate(description.size.begin(), description.size.end(),
                                      std::uint64_t{1}, std::multiplies<>());
  metadata.datatype = static_cast<std::uint8_t>(description.type);
  metadata.imagetype = kMathData;
  metadata.creationtime = metadata.lastaccesstime = now(CLOCK_TAI);
  metadata.creator_pid = metadata.owner_pid = getpid();
  metadata.shared = 1;
  metadata.location = -1;
  metadata.sem = kStreamSemaphores;
  metadata.traces = kStreamTraces;
  metadata.keywords = kKeywords;
  metadata.data_bytes = metadata.nelement * bytes_of(description.type);
  return metadata;
}

bool is_ours(const MappedStream& stream) {
  const auto keywords = stream.keywords();
  return keywords.size() == kKeywords && std::strcmp(keywords[kCreator].name, "CREATOR") == 0 &&
         std::strcmp(keywords[kCreator].text, "curlew") == 0;
}

bool same_shape(const StreamMetadata& a, const StreamMetadata& b) {
  return a.naxis == b.naxis && std::equal(std::begin(a.size), std::end(a.size), b.size) &&
         a.datatype == b.datatype && a.sem == b.sem && a.traces == b.traces &&
         a.keywords == b.keywords;
}

/// Allocates the file's memory now, because a folder that is full later would kill the process.
void allocate(const std::string& path, int descriptor, std::size_t bytes) {
  const int error = posix_fallocate(descriptor, 0, static_cast<off_t>(bytes));
  if (error == 0) return;
  close(descriptor);
  std::remove(path.c_str());
  refuse(path,
         "needs " + std::to_string(bytes) + " bytes: " + std::generic_category().message(error));
}

/// Holds the file for this process. The kernel lets go of it even if the process is killed.
void claim(const MappedStream& stream) {
  if (flock(stream.descriptor(), LOCK_EX | LOCK_NB) != 0)
    refuse(stream.path(),
           "is written by a Curlew that runs; set another prefix in section [publish]");
}

/// Makes the file under another name and renames it, so that nobody sees half a stream.
MappedStream make_file(const std::string& path, const StreamDescription& description) {
  const StreamMetadata metadata = metadata_of(description);
  const std::string unfinished = path + ".new";
  std::remove(unfinished.c_str());
  const int descriptor = open(unfinished.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0664);
  if (descriptor < 0)
    refuse(path, std::string("cannot be made: ") + std::generic_category().message(errno) +
                     "; make the folder, or set folder in section [publish]");
  // Readers of the same group write to the semaphores, whatever the umask is.
  static_cast<void>(fchmod(descriptor, 0664));
  allocate(unfinished, descriptor, layout_of(metadata).bytes);
  MappedStream stream(unfinished, descriptor);
  stream.metadata() = metadata;
  stream.lay_out();
  struct stat status {};
  fstat(descriptor, &status);
  stream.metadata().inode = status.st_ino;
  set_keywords(stream.keywords(), description);
  for (sem_t& semaphore : stream.semaphores()) sem_init(&semaphore, 1, 0);
  sem_init(&stream.log_semaphore(), 1, 0);
  std::fill(stream.read_pids().begin(), stream.read_pids().end(), -1);
  std::fill(stream.write_pids().begin(), stream.write_pids().end(), -1);
  claim(stream);
  std::atomic_thread_fence(std::memory_order_release);
  set_text(stream.metadata().version, kStreamVersion);
  if (std::rename(unfinished.c_str(), path.c_str()) != 0) {
    const std::string why = std::generic_category().message(errno);
    std::remove(unfinished.c_str());
    refuse(path, "cannot be named: " + why);
  }
  return stream;
}

/// Returns the stream of an earlier run; nullopt where there is none, or one of another shape,
/// which may then be replaced.
std::optional<MappedStream> take_over(const std::string& path,
                                      const StreamDescription& description) {
  if (!std::filesystem::exists(path)) return std::nullopt;
  MappedStream stream = [&] {
    try {
      return MappedStream::open(path);
    } catch (const Failure& failure) {
      throw Failure(std::string(failure.what()) + "; remove it if nobody needs it");
    }
  }();
  if (!is_ours(stream))
    refuse(path, "belongs to another program; set another prefix in section [publish]");
  claim(stream);
  StreamMetadata wanted = metadata_of(description);
  if (!same_shape(stream.metadata(), wanted)) return std::nullopt;
  stream.metadata().creator_pid = stream.metadata().owner_pid = getpid();
  set_keywords(stream.keywords(), description);
  return stream;
}

MappedStream open_stream(const std::string& path, const StreamDescription& description) {
  if (auto earlier = take_over(path, description)) return std::move(*earlier);
  return make_file(path, description);
}

void post(sem_t& semaphore) noexcept {
  int value = 0;
  if (sem_getvalue(&semaphore, &value) == 0 && value < kMostPosts) sem_post(&semaphore);
}

}  // namespace

StreamWriter::StreamWriter(const std::string& folder, const StreamDescription& description)
    : stream_(open_stream(folder + "/" + description.name + ".im.shm", description)) {
  // A writer that was killed in the middle of an update has left it marked.
  std::atomic_ref(stream_.metadata().write).store(0, std::memory_order_release);
}

std::byte* StreamWriter::begin() noexcept {
  // As an exchange it keeps the writes that follow behind it.
  std::atomic_ref(stream_.metadata().write).exchange(1, std::memory_order_acq_rel);
  return stream_.data();
}

void StreamWriter::end(const StreamStamp& stamp, std::int64_t count) noexcept {
  StreamMetadata& metadata = stream_.metadata();
  const auto keywords = stream_.keywords();
  keywords[kFrame].number = stamp.frame_index;
  keywords[kSequence].number = stamp.sequence;
  keywords[kTime].number = stamp.received_ns / 1000;
  keywords[kStatus].number = stamp.status;
  keywords[kCount].number = count;
  metadata.atime = tai_of(stamp.received_ns);
  metadata.writetime = now(CLOCK_TAI);
  std::atomic_ref(metadata.cnt0).fetch_add(1, std::memory_order_release);
  std::atomic_ref(metadata.write).store(0, std::memory_order_release);
  for (sem_t& semaphore : stream_.semaphores()) post(semaphore);
  post(stream_.log_semaphore());
}

}  // namespace curlew
