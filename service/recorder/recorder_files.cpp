#include "service/recorder/recorder_files.h"

#include <fmt/format.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <cerrno>
#include <ctime>
#include <exception>
#include <filesystem>
#include <system_error>
#include <utility>

#include "core/error.h"
#include "core/utc_now.h"
#include "service/program/utc_name.h"
#include "service/program/version.h"

namespace curlew {
namespace {

using std::chrono::steady_clock;

constexpr std::int64_t kMegabyte = 1'000'000;
constexpr std::chrono::milliseconds kCommitInterval{500};
constexpr std::chrono::seconds kLookInterval{1};
// The headers and the padding behind the frames need less than this many bytes.
constexpr std::int64_t kBlocks = std::int64_t{20} * 2880;

bool taken(const std::filesystem::path& path) {
  std::error_code ignored;
  return std::filesystem::exists(path, ignored) ||
         std::filesystem::exists(path.string() + kCompressedSuffix, ignored);
}

std::int64_t free_bytes(const std::string& folder) {
  struct statvfs disk {};
  if (statvfs(folder.c_str(), &disk) != 0) {
    throw Failure(folder + " cannot be written: " + std::generic_category().message(errno));
  }
  return static_cast<std::int64_t>(disk.f_bavail) * static_cast<std::int64_t>(disk.f_frsize);
}

// This lies well above min_free_mb, so that recording does not stop and go on all the time.
std::int64_t resume_mb(const RecorderOptions& options) {
  return 2 * std::int64_t{options.min_free_mb} + options.memory_mb;
}

void require_writable(const std::string& folder) {
  std::error_code ignored;
  if (!std::filesystem::is_directory(folder, ignored)) {
    throw Failure("the recorder's folder " + folder +
                  " does not exist: make it, or set recorder.folder");
  }
  if (access(folder.c_str(), W_OK | X_OK) != 0) {
    throw Failure("the recorder's folder " + folder +
                  " cannot be written: " + std::generic_category().message(errno));
  }
}

}  // namespace

RecorderFiles::RecorderFiles(RecorderOptions options, const FrameFormat& format,
                             RecordingHeader header, std::function<void(const std::string&)> log)
    : options_(std::move(options)),
      format_(format),
      header_(std::move(header)),
      log_(std::move(log)) {
  require_writable(options_.folder);
  if (format.scale_adu != 1.0 || format.zero_adu != 0.0) {
    throw Failure("the recorder takes frames in plain ADU only: record the source of these");
  }
  if (options_.compress) {
    compressor_ = std::make_unique<RecordingCompressor>(options_.min_free_mb * kMegabyte, log_);
  }
}

RecorderCounts RecorderFiles::counts() const {
  return {recorded_.load(std::memory_order_relaxed), dropped_.load(std::memory_order_relaxed),
          files_.load(std::memory_order_relaxed), stopped_.load(std::memory_order_relaxed)};
}

// Does the act. Where it throws, recording stops for good.
template <typename Act>
void RecorderFiles::or_fail(Act&& act) noexcept {
  try {
    act();
  } catch (const std::exception& error) {
    std::string sentence = fmt::format("recording stopped: {}", error.what());
    if (file_) {
      count_recorded();
      if (file_->committed() > 0)
        sentence += fmt::format("; its first {} frames are whole", file_->committed());
      file_.reset();
    }
    count_the_rest_dropped();
    failed_ = true;
    stopped_ = true;
    log_(sentence + "; restart to record again");
  }
}

void RecorderFiles::write(const FrameBuffer& frame) noexcept {
  ++given_;
  or_fail([&] {
    if (file_ && file_is_full(frame.header)) complete_file();
    if (!disk_has_room()) {
      count_the_rest_dropped();
      return;
    }
    if (!file_) begin_file(frame.header);
    file_->append(frame.view(), frame.header);
    count_recorded();
  });
  commit_if_due();
}

void RecorderFiles::commit_if_due() noexcept {
  if (file_ && steady_clock::now() >= next_commit_) or_fail([&] { commit(); });
}

void RecorderFiles::end_file() noexcept {
  if (file_) or_fail([&] { complete_file(); });
}

void RecorderFiles::begin_file(const FrameHeader& first) {
  const std::int64_t utc_ns = first.received_ns > 0 ? first.received_ns : utc_now_ns();
  const std::filesystem::path folder = options_.folder;
  const std::string name = "curlew-" + utc_name(utc_ns);
  std::filesystem::path path = folder / (name + ".fits");
  for (int n = 2; taken(path); ++n) path = folder / fmt::format("{}-{}.fits", name, n);
  Provenance provenance = header_.provenance;
  provenance.observed_ns = utc_ns;
  file_ = std::make_unique<GrowingRecording>(path.string(), format_, header_.optics,
                                             header_.detector, provenance);
  in_whole_files_ = recorded_;
  first_received_ = first.received;
  next_commit_ = {};  // It is due at once, so that the file appears with its first frame.
  files_.fetch_add(1, std::memory_order_relaxed);
  log_(fmt::format("recording to {}", path.string()));
}

bool RecorderFiles::file_is_full(const FrameHeader& next) const {
  const std::chrono::duration<double> age = next.received - first_received_;
  return age.count() >= options_.max_file_s ||
         file_->bytes() + static_cast<std::int64_t>(format_.bytes()) >
             options_.max_file_mb * kMegabyte;
}

void RecorderFiles::describe(const RecordingHeader& header) noexcept {
  or_fail([&] {
    if (header.provenance == header_.provenance) return;
    if (file_) complete_file();
    header_ = header;
  });
}

void RecorderFiles::commit() {
  file_->commit();
  count_recorded();
  next_commit_ = steady_clock::now() + kCommitInterval;
  notice_loss();
}

/// Gives up a file that does not have its name any more.
void RecorderFiles::notice_loss() {
  const GrowingRecording::Whereabouts where = file_->whereabouts();
  if (where == GrowingRecording::Whereabouts::kHere) return;
  const bool is_lost = where == GrowingRecording::Whereabouts::kRemoved;
  const std::string path = file_->path();
  const std::int64_t frames = file_->frames();
  file_.reset();
  if (is_lost) {
    recorded_.store(in_whole_files_, std::memory_order_relaxed);
    count_the_rest_dropped();
    log_(fmt::format("{} was removed while it was recorded: its {} frames are lost", path, frames));
  } else {
    log_(fmt::format("{} was moved while it was recorded: it ends there, after {} frames", path,
                     frames));
  }
}

void RecorderFiles::complete_file() {
  commit();
  if (!file_) return;
  const std::string path = file_->path();
  const std::int64_t frames = file_->committed();
  const auto bytes = static_cast<double>(file_->bytes());
  file_.reset();
  log_(fmt::format("{} is complete: {} frames, {:.1f} MB", path, frames, bytes / kMegabyte));
  if (compressor_) compressor_->add(path);
}

bool RecorderFiles::disk_has_room() {
  if (stopped_) return !failed_ && room_is_back();
  if (!file_ && !folder_is_there()) {
    stop(options_.min_free_mb, fmt::format("the folder {} is gone; it goes on by itself once it is "
                                           "there again",
                                           options_.folder));
    return false;
  }
  // The disk must take the next frame, and behind it the whole table again, with one row more.
  const std::int64_t rows = 1 + (file_ ? file_->frames() : 0);
  const std::int64_t next =
      static_cast<std::int64_t>(format_.bytes()) + rows * kFrameRowBytes + kBlocks;
  // The folder of a file that goes on may be gone; the next look at the file finds out.
  if (!folder_is_there() || free_bytes(options_.folder) - next >= options_.min_free_mb * kMegabyte)
    return true;
  if (file_) complete_file();
  stop(resume_mb(options_),
       fmt::format("the disk of {} would have less than {} MB left (recorder.min_free_mb); it goes "
                   "on by itself once {} MB are free",
                   options_.folder, options_.min_free_mb, resume_mb(options_)));
  return false;
}

bool RecorderFiles::folder_is_there() const {
  std::error_code ignored;
  return std::filesystem::is_directory(options_.folder, ignored);
}

void RecorderFiles::stop(std::int64_t resume_mb, const std::string& why) {
  stopped_ = true;
  resume_mb_ = resume_mb;
  next_look_ = steady_clock::now() + kLookInterval;
  log_("recording stopped: " + why);
}

bool RecorderFiles::room_is_back() {
  if (steady_clock::now() < next_look_) return false;
  next_look_ = steady_clock::now() + kLookInterval;
  if (!folder_is_there() || free_bytes(options_.folder) < resume_mb_ * kMegabyte) return false;
  stopped_ = false;
  log_(fmt::format("recording goes on: {} has {} MB free", options_.folder,
                   free_bytes(options_.folder) / kMegabyte));
  return true;
}

void RecorderFiles::count_recorded() {
  recorded_.store(in_whole_files_ + file_->committed(), std::memory_order_relaxed);
}

// Call it only while no frame waits for a commit.
void RecorderFiles::count_the_rest_dropped() {
  dropped_.store(given_ - recorded_.load(std::memory_order_relaxed), std::memory_order_relaxed);
}

}  // namespace curlew
